"""A law outside the list: its place, its curve and its worth on a run that did not choose it."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.signal import firwin

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.posterior.model_fit import ModelFit, added_rows, tapered_spectrum, transfers
from rover_sweep.diagnosis.posterior.unnamed import groups, unit_spectra
from rover_sweep.diagnosis.problem.least_squares import Fitted, fit, sensitivities
from rover_sweep.diagnosis.problem.residuals import Problem, problem
from rover_sweep.diagnosis.result import Unknown
from rover_sweep.diagnosis.simulation.experiment import RATE, Experiment, tapered
from rover_sweep.diagnosis.simulation.simulator import logged, motion
from rover_sweep.diagnosis.simulation.table_law import TableLaw, refuse_law, resonator, with_laws
from rover_sweep.diagnosis.unexplained import NO_LAW, find_laws, input_places, with_laws_of
from tests.diagnosis.planted import MODEL, NOISE, X, sweeps

DAMPING = TableLaw("yaw moment", "r", (-1.4, -0.7, 0.0, 0.7, 1.4), (0.4, 0.1, 0.0, -0.1, -0.4))
LAWS = {
    "yaw moment": DAMPING,
    "steering": TableLaw("steering", "delta", (-0.2, -0.1, 0.1, 0.2), (0.02, 0.0, 0.0, -0.02)),
    "sensor of r": TableLaw("sensor of r", "signal", (-2.0, 0.0, 2.0), (0.1, 0.0, 0.1)),
}
PART = slice(3000, 8400)  # 27 s in the middle of the sweep


def _shortened(run: Experiment) -> Experiment:
    """The middle of a sweep."""
    t = run.t[PART] - run.t[PART][0]
    return replace(
        run,
        t=t,
        steer=run.steer[PART],
        commanded=None,
        speed=run.speed[PART],
        heading=run.heading[PART],
        measured={c: x[PART] for c, x in run.measured.items()},
        taper=tapered(t.size),
    )


def _with_law(law: TableLaw, seed: int) -> tuple[list[Experiment], list[dict[str, Array]]]:
    """Shortened sweeps of the model with the law, with noise: (runs, their noise)."""
    random = np.random.default_rng(seed)
    runs, noise = [], []
    for run in map(_shortened, sweeps(seed, ((0.2, 2.2), (0.12, 1.6), (0.15, 2.0)))):
        mess = {c: s * random.standard_normal(run.t.size) for c, s in NOISE.items()}
        true = logged(run, with_laws(MODEL, (law,)), X)
        runs.append(replace(run, measured={c: y + mess[c] for c, y in true.items()}))
        noise.append(mess)
    return runs, noise


def _fitted(runs: list[Experiment], noise: list[dict[str, Array]]) -> tuple[Problem, Fitted]:
    found = problem(runs, noise)
    return found, sensitivities(found, fit(found, MODEL, X, steps=4))


def _last(used: Problem, base: Fitted) -> ModelFit:
    return ModelFit(used, base, base, {})


def test_the_place_of_a_planted_law_is_found_and_holds_on_another_run() -> None:
    runs, noise = _with_law(LAWS["steering"], 3)
    used, base = _fitted(runs[:2], noise[:2])
    found = find_laws(_last(used, base), {"run3": problem(runs[2:], noise[2:])})
    assert found is not None and found.holds
    assert "steering" in (found.laws[0].law.place, *found.laws[0].alternatives)
    assert found.share_removed is not None and found.share_removed > 0.7


def test_the_unknown_says_place_curve_worth_and_next_run() -> None:
    runs, noise = _with_law(LAWS["sensor of r"], 3)
    used, base = _fitted(runs[:2], noise[:2])
    held: Any = SimpleNamespace(run=SimpleNamespace(name="run3"), problem=problem(runs[2:], noise[2:]))
    found, laws = with_laws_of(
        Unknown("r", "r", 2.0, "r differs; nothing predicts it"), _last(used, base), (held,)
    )
    assert laws and found.place == "sensor of r" and len(found.curves) == 1
    curve, at = found.curves[0], np.array(found.curves[0].x)
    assert curve.over == "signal" and curve.over_unit == curve.unit == "rad/s"
    inside = np.abs(at) > 0.3
    assert np.allclose(np.array(curve.y)[inside], 0.05 * np.abs(at[inside]), rtol=0.5)
    assert all(low <= y <= high for low, y, high in zip(curve.low, curve.y, curve.high, strict=True))
    assert found.could_be in found.sentence and found.next_run in found.sentence
    assert "% of the residual" in found.sentence
    (judged,) = found.held_out
    assert judged.after < judged.before and judged.run == "run3"


def test_without_a_law_the_unknown_says_so() -> None:
    runs, noise = _with_law(replace(DAMPING, y=(0.0,) * 5), 5)
    used, base = _fitted(runs[:1], noise[:1])
    found, laws = with_laws_of(Unknown("r", "r", 2.0, "r differs"), _last(used, base), ())
    assert laws is None and NO_LAW in found.sentence and not found.curves and not found.place


@pytest.mark.parametrize("place", ["sensor of ay", "steering", "yaw moment"])
def test_the_place_of_an_input_without_a_law_is_found(place: str) -> None:
    """Noise of 1 to 4 Hz that depends on nothing is added at a place."""
    runs, noise = _with_law(replace(DAMPING, y=(0.0,) * 5), 5)
    used, base = _fitted(runs[:1], noise[:1])
    found = transfers(used.runs, base.model, base.x)
    random = np.random.default_rng(2).standard_normal(runs[0].t.size)
    low_pass = firwin(401, [1.0, 4.0], pass_zero=False, fs=RATE)
    s = {"sensor of ay": 0.6, "steering": 0.02, "yaw moment": 0.5}[place] * np.convolve(
        random, low_pass, "same"
    )
    added = added_rows(used, found, place, [tapered_spectrum(runs[0], s)])
    likely = input_places(used, found, base.rows + 4.0 * added)
    assert likely and place in likely[:2]
    assert input_places(used, found, base.rows) == ()


@pytest.mark.parametrize("baseline", ["kinematic", "bicycle", "lumped"])
def test_every_baseline_has_candidates_at_the_places_that_it_has(baseline: str) -> None:
    runs, _ = _with_law(DAMPING, 5)
    other = replace(MODEL, baseline=baseline)
    found = transfers(runs[:1], other, {c.name: c.start for c in other.free})
    places = {law.place for law in groups(found)}
    assert {"steering", "sensor of r"} <= places
    assert ("yaw moment" in places) == (baseline == "bicycle") and "roll moment" not in places


def test_nothing_is_found_where_only_noise_is_left() -> None:
    runs, noise = _with_law(replace(DAMPING, y=(0.0,) * 5), 5)
    used, base = _fitted(runs[:1], noise[:1])
    assert find_laws(_last(used, base), {}) is None


def test_rows_of_a_law_are_those_of_the_simulation() -> None:
    """The impulse responses give the same rows as a simulation with a small law."""
    runs, noise = _with_law(replace(DAMPING, y=(0.0,) * 5), 5)
    one = problem(runs[:1], noise[:1])
    found = transfers(one.runs, MODEL, X)
    for law in LAWS.values():
        small = replace(law, y=tuple(0.01 * y for y in law.y))
        want = one.model(with_laws(MODEL, (small,)), X) - one.model(MODEL, X)
        rows = [added_rows(one, found, law.place, s) for s in unit_spectra(small, found)]
        got = np.column_stack(rows) @ np.array(small.y)
        assert np.linalg.norm(got - want) < 0.1 * np.linalg.norm(want), law.place


@pytest.mark.parametrize(
    "change",
    [
        {"place": "wheel"},
        {"over": "colour"},
        {"times": "phi"},
        {"x": (0.0, 0.0, 1.0, 2.0, 3.0)},
        {"y": (0.0, np.nan, 1.0, 1.0, 1.0)},
        {"y": (0.0, 1.0)},
        {"memory": "play"},
        {"over": "signal"},
        {"place": "steering"},
    ],
)
def test_a_table_that_cannot_be_simulated_is_refused(change: dict[str, object]) -> None:
    with pytest.raises(ValueError, match=r"law|place"):
        refuse_law(replace(DAMPING, **change))  # type: ignore[arg-type]


def test_a_law_with_play_has_a_memory() -> None:
    t = np.arange(400) / RATE
    steer = 0.2 * np.sin(2 * np.pi * t)
    from rover_sweep.diagnosis.effects.steering import play

    out = play(steer, 0.05)
    assert np.max(np.abs(out)) == pytest.approx(0.15, abs=1e-3)
    assert np.max(np.abs(steer - out)) == pytest.approx(0.05, abs=1e-9)


def test_a_pendulum_is_found_as_a_resonance_with_its_frequency() -> None:
    """A hidden resonator that a_y drives pushes the body; its law is found and holds on another run."""
    law = replace(resonator("side force", "a_y", 1.4, 0.1), y=(0.3, 0.0))
    runs, noise = _with_law(law, 3)
    used, base = _fitted(runs[:2], noise[:2])
    found = find_laws(_last(used, base), {"run3": problem(runs[2:], noise[2:])})
    assert found is not None and found.holds
    first = found.laws[0].at(found.fitted.x)
    assert first.memory == "resonance" and first.size == pytest.approx(1.4, rel=0.1)


def test_a_stop_stiffer_than_the_spring_does_not_diverge() -> None:
    """A law inside the loop is part of each step; fixed-point passes over whole runs diverge here."""
    runs, _ = _with_law(replace(DAMPING, y=(0.0,) * 5), 5)
    stop = TableLaw("roll moment", "phi", (-0.2, -0.015, 0.015, 0.2), (60.0, 0.0, 0.0, -60.0))
    phi = {
        name: motion(runs[0], with_laws(MODEL, laws), X)["phi"]
        for name, laws in {"free": (), "stopped": (stop,)}.items()
    }
    assert np.max(np.abs(phi["stopped"])) < 0.8 * np.max(np.abs(phi["free"]))
