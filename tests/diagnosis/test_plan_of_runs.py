"""The engine of `plan`: look-alikes, detectable sizes, and the runs that may be proposed.

Cosines of signatures from an independent study, without instruments in the nominal model: delay and servo
lag 0.99, relaxation and delay 0.94 (0.85 with a second speed), saturation and load transfer 0.94, deadband
and backlash 0.95. This tool gives 0.98, 0.99 (0.90) and 0.85 from r alone, with C, Izz, k_phi and b_phi
refitted, and 0.46, 0.18 (0.59) and 0.68 with all four channels and the whole nominal model. A deadband of the
command and a backlash are nearly orthogonal here (0.1): one subtracts sgn(u), the other sgn(u'). The study
had a deadband of the servo's error, which has memory.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from rover_sweep.data.geometry import Geometry
from rover_sweep.data.tolerances import Tolerances
from rover_sweep.diagnosis.effects import library
from rover_sweep.diagnosis.plans.detectable_sizes import detectable
from rover_sweep.diagnosis.plans.evidence import evidence, typical_floor
from rover_sweep.diagnosis.plans.joint_problem import Expected, expected
from rover_sweep.diagnosis.plans.plan import plan
from rover_sweep.diagnosis.plans.plan_result import Limits, PlannedRun
from rover_sweep.diagnosis.plans.proposals import (
    allowed,
    as_experiment,
    candidates,
    first_set,
    lateral_acceleration,
)
from rover_sweep.diagnosis.plans.set_result import Stacked
from rover_sweep.diagnosis.plans.sets import Planner
from rover_sweep.diagnosis.problem.noise_floor import Floor
from rover_sweep.diagnosis.search.needed_size import sides
from rover_sweep.diagnosis.simulation.candidates import Model, possible

ROVER = Geometry(2.66, 0.203, 0.188, 2.40, 0.058, 0.0125, 0.069)
SCALE = 0.00095  # rad/us
LIMITS = Limits(7.0, 250.0, (0.8, 12.0), "friction 0.9")
SLOW, LARGE, SMALL = (PlannedRun("sweep", a, v) for a, v in ((150.0, 1.6), (240.0, 2.4), (120.0, 2.4)))
BLOCKS, STEPS = PlannedRun("servo_test", 150.0, 0.0), PlannedRun("doublet", 150.0, 2.4)
PHYSICAL = ("ln_C", "ln_Izz", "ln_k_phi", "ln_b_phi")


def planner(spread: Tolerances | None = None, wanted: Sequence[str] = ()) -> Planner:
    return Planner(ROVER, SCALE, wanted, spread or Tolerances(), {}, lambda what, share: None)


@pytest.fixture(scope="module")
def usual() -> Planner:
    found = planner()
    found.simulate((SMALL, LARGE, SLOW, STEPS, BLOCKS), (0.0, 1.0))
    return found


def yaw_rate_cosines(runs: Sequence[PlannedRun]) -> dict[str, float]:
    """Cosines from r alone, C, Izz, k_phi and b_phi refitted."""
    model = Model("roll-yaw", ROVER, Tolerances(lag=0.5, delay=0.5))
    driven = [as_experiment(run, ROVER, SCALE, ["r"]) for run in runs]
    effects = [e for e in possible(model, driven)[0] if not e.in_one_run]
    at = {
        "lag": 0.03,
        "delay": 0.03,
        "tyre_relaxation.sigma": 0.07,
        "tyre_saturation.mu": 0.7,
        "load_transfer.k": 0.3,
    }
    white = Floor(np.array([0.01, 100.0]), {"r": np.full(2, 3e-5)})  # as in the study
    stacked = Stacked.of(model, [evidence(run, model, effects, at, white) for run in driven])
    rows = stacked.outside({c.name for c in model.free} - set(PHYSICAL))
    unit = rows / np.maximum(np.linalg.norm(rows, axis=0), 1e-12)
    place = {e: members[0] for e, members in stacked.members.items()}
    pairs = (
        ("transport_delay", "servo_lag"),
        ("tyre_relaxation", "transport_delay"),
        ("tyre_saturation", "load_transfer"),
        ("steering_deadband", "steering_backlash"),
    )
    return {one: float(unit[:, place[one]] @ unit[:, place[two]]) for one, two in pairs}


def test_look_alikes_are_those_of_the_map() -> None:
    one, two = yaw_rate_cosines((SMALL, STEPS)), yaw_rate_cosines((SMALL, STEPS, SLOW))
    assert one["transport_delay"] > 0.95 and one["tyre_relaxation"] > 0.93
    assert two["tyre_relaxation"] < one["tyre_relaxation"] - 0.05
    assert one["tyre_saturation"] == pytest.approx(0.94, abs=0.12)
    assert abs(one["steering_deadband"]) < 0.3


def test_few_rows_stand_for_many(usual: Planner) -> None:
    """Inner products of the nominal's sensitivities and a signature, from all rows and from the few."""
    from rover_sweep.diagnosis.plans.evidence import start
    from rover_sweep.diagnosis.problem.least_squares import sensitivities
    from rover_sweep.diagnosis.problem.residuals import with_floor
    from rover_sweep.diagnosis.problem.signatures import signatures

    problem = with_floor([usual.experiment(STEPS)], typical_floor())
    base = start(usual.model, problem.size)
    problem = replace(problem, measured=problem.model(usual.model.structure, base.x))
    many = (
        sensitivities(problem, base).jacobian.T
        @ signatures(problem, base, usual.model, usual.effects[:1])[0].rows
    )
    few = usual._evidence[STEPS]
    assert few.size < 100 < problem.size
    np.testing.assert_allclose(
        few.nominal.T @ few.effects[0].rows, many, rtol=1e-6, atol=1e-6 * np.abs(many).max()
    )


def test_more_runs_show_smaller_sizes(usual: Planner) -> None:
    few, more = usual.evaluate((SMALL,)).stacked.sizes, usual.evaluate((SMALL, LARGE, SLOW)).stacked.sizes
    for effect in ("tyre_saturation", "load_transfer", "roll_steer", "steering_nonlinearity"):
        assert (
            next(iter(more[effect].values())).coordinate < 0.8 * next(iter(few[effect].values())).coordinate
        )


def test_a_repeat_tells_noise_from_distortion_and_so_does_a_periodic_wave(usual: Planner) -> None:
    assert usual.evaluate((SMALL, LARGE)).noise_unknown
    assert not usual.evaluate((replace(SMALL, repeat=2),)).noise_unknown
    usual.simulate((PlannedRun("multisine", 150.0, 2.4),), (0.0, 1.0))
    assert not usual.evaluate((SMALL, PlannedRun("multisine", 150.0, 2.4))).noise_unknown


def test_blocks_show_the_steering_and_nothing_else(usual: Planner) -> None:
    shown = {s.effect: float(np.linalg.norm(s.rows)) for s in usual._evidence[BLOCKS].effects}
    steering = (
        "servo_rate_limit",
        "steering_deadband",
        "steering_backlash",
        "steering_asymmetry",
        "steering_nonlinearity",
        "servo_lag",
        "transport_delay",
        "steering_stiction",
        "steering_scale",
    )
    assert all(shown[e] > 10.0 for e in steering)
    assert all(
        size < 1e-6 for e, size in shown.items() if e not in (*steering, "clock_offset", "steering_trim")
    )


def test_blocks_tell_a_delay_from_sensor_filters(usual: Planner) -> None:
    alike = usual.evaluate((SMALL, SLOW)).stacked.cosine("transport_delay", "sensor_filter")
    assert alike > 0.85
    assert usual.evaluate((SMALL, SLOW, BLOCKS)).stacked.cosine("transport_delay", "sensor_filter") < 0.5


def test_two_clocks_make_an_offset_a_delay(usual: Planner) -> None:
    one = Stacked.of(usual.model, [usual._evidence[SMALL]])
    two = Stacked.of(replace(usual.model, two_clocks=True), [usual._evidence[SMALL]])
    assert one.cosine("clock_offset", "transport_delay") < 0.1
    assert two.cosine("clock_offset", "transport_delay") == pytest.approx(1.0)


def test_material_sizes_move_what_is_found() -> None:
    def sizes(spread: Tolerances) -> dict[str, float]:
        one = planner(spread)
        one.simulate((STEPS,), (0.0, 1.0))
        found = one.evaluate((STEPS,)).stacked.sizes
        return {
            e: next(iter(found[e].values())).coordinate
            for e in ("imu_tilt", "transport_delay", "steering_trim")
        }

    usual, loose = sizes(Tolerances()), sizes(Tolerances(bias_ay=0.6, together=0.1, trim=0.03))
    assert loose["imu_tilt"] - usual["imu_tilt"] == pytest.approx(0.3 / 9.81, rel=0.1)
    assert loose["transport_delay"] - usual["transport_delay"] == pytest.approx(0.028, abs=1e-6)
    assert loose["steering_trim"] - usual["steering_trim"] == pytest.approx(0.02, rel=0.1)


@pytest.mark.parametrize("limit", [1.0, 3.0, 7.0])
def test_nothing_is_proposed_that_the_rover_cannot_hold(limit: float) -> None:
    limits = replace(LIMITS, ay=limit)
    base = first_set(ROVER, SCALE, limits)
    found = candidates((LARGE, *base), ROVER, SCALE, limits)
    assert {run.kind for run in found} >= {"sweep", "doublet", "servo_test"}
    assert all(lateral_acceleration(run, ROVER, SCALE) <= limit for run in (*base, *found))
    assert all(run.amplitude_us + abs(run.bias_us) <= limits.amplitude_us for run in found)
    assert allowed(LARGE, ROVER, SCALE, limits) == (limit > 3.4)


def test_every_kind_may_be_proposed() -> None:
    found = candidates((SMALL,), ROVER, SCALE, LIMITS)
    assert {run.kind for run in found} == {"sweep", "doublet", "bias_sweep", "multisine", "servo_test"}
    assert len({run.speed for run in found if run.speed}) > 2 and len({run.amplitude_us for run in found}) > 2
    assert SMALL in found and any(run.heading == 180.0 for run in found)


def test_a_plan_proposes_what_settles_the_open_points(monkeypatch: pytest.MonkeyPatch) -> None:
    """A small sweep hardly reaches the rate limit of a servo: the answer is a run that does."""
    every = candidates((SMALL,), ROVER, SCALE, LIMITS)
    short = [r for r in every if r.kind == "servo_test" or (r.kind == "doublet" and r.speed > 2.0)]
    monkeypatch.setattr("rover_sweep.diagnosis.plans.plan.candidates", lambda *_: [*short, *short[:1]])
    shares: list[float] = []
    found = plan(
        (PlannedRun("sweep", 60.0, 2.4),),
        ROVER,
        SCALE,
        LIMITS,
        ("servo_rate_limit",),
        progress=lambda what, share: shares.append(share),
    )
    assert [u.effect for u in found.cannot_see] == ["servo_rate_limit"] and not found.detectable
    assert 1 <= len(found.proposal) == len(found.settles) <= 3
    assert "servo_rate_limit" in found.settles[0] and "noise from distortion" in " ".join(found.settles)
    assert not found.proposed_look_alikes
    assert (
        found.sentences[0].startswith("these runs detect and separate 0 of 1")
        and "7.0 m/s^2" in found.notes[0]
    )
    assert shares == sorted(shares) and shares[-1] <= 1.0


@pytest.fixture(scope="module")
def three() -> Expected:
    """What a diagnosis of three sweeps would use."""
    one = planner(wanted=("front_rear_stiffness", "steering_backlash", "imu_offset"))
    runs = [one.experiment(run) for run in (SMALL, LARGE, SLOW)]
    effects = [e for e in one.effects if e.id in one.wanted]
    return expected(runs, one.model, effects, one.assumed)


def test_a_detectable_size_holds_for_both_signs(three: Expected) -> None:
    """A softer front axle shows less than a softer rear axle; the size is that of the front axle."""
    size = detectable(three, ("front_rear_stiffness",))["front_rear_stiffness"].size
    assert size is not None and 1.2 < size < 1.5
    effect, needed = library()["front_rear_stiffness"], np.sqrt(three.thresholds["front_rear_stiffness"])
    lengths = []
    for side in sides(effect, three.signals.model, ()):
        rows = three.signals.rows(side, np.log(size) - 0.15)
        lengths.append(float(np.linalg.norm(three.signals.reach(effect).outside(rows))))
    assert lengths[1] == pytest.approx(needed, rel=0.1) and lengths[0] > 1.3 * needed


def test_a_detectable_size_is_not_below_the_one_that_matters(three: Expected) -> None:
    found = detectable(three, ("steering_backlash", "imu_offset"))
    assert all(s.size is not None and s.material is not None and s.size >= s.material for s in found.values())


def test_recorded_noise_counts_in_a_plan() -> None:
    """Ten times the noise power makes the same tyre saturation harder to find: its mu must be smaller."""
    one = planner(wanted=("tyre_saturation",))
    effects = [e for e in one.effects if e.id in one.wanted]
    loud = Floor(one.assumed.floor.f, {c: 10.0 * d for c, d in one.assumed.floor.density.items()})
    found = []
    for floor in (one.assumed.floor, loud):
        runs = expected([one.experiment(SMALL)], one.model, effects, replace(one.assumed, floor=floor))
        found.append(detectable(runs, one.wanted)["tyre_saturation"].size or 0.0)
    assert 0.0 < found[1] < 0.8 * found[0]


def test_runs_on_blocks_count_in_the_detectable_sizes() -> None:
    """A small sweep hardly reaches the rate limit of a servo; on blocks it can be larger."""
    one, small = planner(wanted=("servo_rate_limit",)), PlannedRun("sweep", 60.0, 2.4)
    few, more = one.sizes((small,)), one.sizes((small, BLOCKS))
    reached, needed = (s["servo_rate_limit"].size if s else 0.0 for s in (few, more))
    assert needed is not None and reached is not None and needed > 1.3 * reached
