"""J_rms and TIC by hand, and the biases that are solved first."""

from dataclasses import replace

import numpy as np
import pytest
from synthetic import GEOMETRY, TRUE, driven

from rover_sweep.data.recording import Recording
from rover_sweep.identification.fit import Condition, ResponseData, evaluated, fit, sampled
from rover_sweep.identification.grouping import Settings
from rover_sweep.identification.models import lumped, roll_yaw
from rover_sweep.identification.pipeline import identify
from rover_sweep.identification.verdicts import reduce_model
from rover_sweep.identification.verify import Overlay, theil, verify
from rover_sweep.manoeuvre.sweep import Doublet, Sweep
from rover_sweep.quality.coherence import responses

TRUTH = roll_yaw(GEOMETRY).with_values(TRUE)
SHORT = Sweep(t_rec=25.0, w_min=0.6, w_max=25.0)


@pytest.fixture(scope="module")
def clean() -> Recording:
    return driven(TRUTH, Sweep(amplitude=120, t_rec=20))


@pytest.fixture(scope="module")
def run() -> Recording:
    return driven(TRUTH, SHORT, noise=0.003)


def overlay(measured: list[float], model: list[float]) -> Overlay:
    return Overlay("r", "deg/s", np.arange(len(measured)) * 0.1, np.array(measured), np.array(model))


def test_theil_by_hand():
    one = overlay([3.0, -3.0, 3.0], [1.0, -1.0, 1.0])
    assert one.j_rms == pytest.approx(2.0)
    assert theil([one]) == pytest.approx(2.0 / (3.0 + 1.0))
    both = theil([one, overlay([0.0, 0.0], [4.0, 4.0])])
    assert both == pytest.approx(np.sqrt((4 + 16) / 2) / (np.sqrt(9 / 2) + np.sqrt((1 + 16) / 2)))


def test_accelerations_count_in_feet(clean):
    """The guideline J_rms <= 2 means nothing in other units."""
    run, ay = clean, clean["ay"]
    raised = replace(ay, x=ay.x + 0.3048 * np.where(np.arange(ay.x.size) % 2, 1.0, -1.0))
    found = verify(TRUTH, replace(run, channels={**run.channels, "ay": raised}), channels=("ay",))
    assert found.overlays[0].unit == "ft/s^2"
    assert found.j_rms == pytest.approx(1.0, rel=0.02)


def test_doublet_wave_goes_both_ways():
    wave = Doublet(amplitude=100, pulse=1, pause=2, count=1, straight=1)
    assert list(wave.wave(np.array([0.5, 1.5, 2.5, 3.5]))) == [0, 100, -100, 0]


def test_the_truth_leaves_nothing_and_output_biases_are_solved(clean):
    """A doublet is short compared with the roll mode, so state biases cannot replace those of the output."""
    plain = verify(TRUTH, clean)
    assert plain.tic < 0.02
    assert verify(TRUTH.with_values({"Izz": 2 * TRUE["Izz"]}), clean).tic > 3 * plain.tic
    for channel in ("r", "p", "ay"):
        signal = clean[channel]
        channels = {**clean.channels, channel: replace(signal, x=signal.x + 0.2)}
        found = verify(TRUTH, replace(clean, channels=channels))
        assert found.j_rms == pytest.approx(plain.j_rms, rel=0.05)
        assert found.output_biases[channel] - plain.output_biases[channel] == pytest.approx(0.2, abs=0.12)


def test_a_model_that_runs_away_is_verified_as_useless_and_not_with_an_error(run):
    """A lumped model may fit every response and still have an unstable pole."""
    stable = lumped(GEOMETRY, TRUTH, 2.4)
    unstable = stable.with_values({"L_p": 200.0})
    assert verify(stable, run).tic < 0.05
    assert unstable.poles(2.4).real.max() > 1
    found = verify(unstable, run)
    assert np.isfinite(found.j_rms) and found.j_rms > 100
    assert found.tic == pytest.approx(1.0, abs=0.02)


def test_reduction_keeps_what_a_stable_model_needs_to_stay_stable(monkeypatch, run):
    """Whatever the cost says, a drop may not turn a stable model unstable."""
    found = responses([run])
    data = tuple(sampled(f, f.band) for f in found.values() if f.band and f.output in ("r", "ay", "p"))
    condition = Condition(2.4, data, {})
    full = evaluated(lumped(GEOMETRY, TRUTH, 2.4), [condition])

    def unstable_and_cheap(structure, *_, **__):
        return replace(evaluated(structure.with_values({"L_p": 50.0}), [condition]), costs=full.costs)

    monkeypatch.setattr("rover_sweep.identification.verdicts.fit", unstable_and_cheap)
    best, steps = reduce_model(full, [condition])
    assert best is full
    assert steps and all(s.unstable and not s.dropped for s in steps)


# ---- Structure reduction: physical parameters go back to what the vehicle file says, step by step.

FREED = ("Ixx", "Ixz", "h")
FREE_GEOMETRY = replace(GEOMETRY, free=FREED)
ROLL_YAW = Settings(models=("roll-yaw",))


@pytest.fixture(scope="module")
def noisy():
    return driven(TRUTH, Sweep(amplitude=120), noise=0.01, seed=4)


def fixed(model) -> dict[str, float]:
    return {s.parameter: s.value for s in model.reduction if s.dropped}


def test_every_step_says_why_and_what_it_cost(noisy):
    model = identify([noisy], FREE_GEOMETRY, settings=ROLL_YAW).models["roll-yaw"]
    assert set(fixed(model)) == set(FREED)
    assert model.reduction[0].before == pytest.approx(model.variants["before reduction"].average)
    assert model.reduction[-1].after == pytest.approx(model.fit.average)
    for step, following in zip(model.reduction, model.reduction[1:], strict=False):
        assert following.before == (step.after if step.dropped else step.before)
    assert all("% > " in s.reason for s in model.reduction)
    assert model.reduction[0].found == model.variants["before reduction"][model.reduction[0].parameter].value


def test_it_can_be_stopped_and_told_what_to_keep(noisy):
    off = identify([noisy], FREE_GEOMETRY, settings=replace(ROLL_YAW, reduction=False)).models["roll-yaw"]
    assert not off.reduction and off.fit["Ixz"].free and "before reduction" not in off.variants
    kept = identify([noisy], FREE_GEOMETRY, settings=replace(ROLL_YAW, keep=("h",))).models["roll-yaw"]
    assert kept.fit["h"].free and "h" not in {s.parameter for s in kept.reduction}


def test_a_vehicle_file_that_is_wrong_is_not_forced_on_the_data():
    """The roll inertia of the file is three times the true one: fixing it there would spoil the fit."""
    structure = roll_yaw(replace(GEOMETRY, roll_inertia=3 * GEOMETRY.roll_inertia))
    w = np.geomspace(0.4, 18, 20)
    seen = {o: ResponseData(o, w, TRUTH.response(w, 2.4, o), np.full(20, 0.6)) for o in ("r", "ay", "p")}
    condition = Condition(2.4, tuple(seen.values()), {})
    start = structure.with_free([*(p.name for p in structure.free), "Ixx"])
    result, steps = reduce_model(fit(start, [condition]), [condition], {"Ixx": structure.values["Ixx"]})
    assert [(s.parameter, s.dropped) for s in steps] == [("Ixx", False)]
    assert result["Ixx"].value == pytest.approx(GEOMETRY.roll_inertia, rel=0.01)
