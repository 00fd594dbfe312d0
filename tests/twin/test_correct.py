"""Differences become entries of a simulated rover."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest

from rover_sweep.comparison.answer import Comparison, Difference
from rover_sweep.data.geometry import Geometry
from rover_sweep.data.results import ByName, Quantity
from rover_sweep.diagnosis.simulation.augmented import AugmentedModel
from rover_sweep.twin.correct import corrected
from rover_sweep.twin.loop import variant_with_reasons
from sitl.plant.variant import load_variant

NOMINAL = load_variant("nominal")
ROVER = Geometry(mass=2.66, a=0.203, b=0.188, yaw_inertia=0.07)


def _value(name: str, value: float) -> Quantity:
    return Quantity(name, "", value, 0.9 * value, 1.1 * value)


def _difference(name: str, simulation: float, recordings: float, **more) -> Difference:
    parameter, kind = more.get("parameter", name), more.get("kind", "number")
    relative = more.get("relative", False)
    change = recordings / simulation if relative else recordings - simulation
    one, two = (ByName((_value(parameter, v),)) for v in (simulation, recordings))
    return Difference(kind, name, one, two, {parameter: change}, relative, 100.0, (), f"{name} differs")


def _corrected(d: Difference, rover=NOMINAL, effects=(), x=None):
    model = AugmentedModel("bicycle", ROVER, effects, x or {}, 2.0)
    return corrected(rover, Comparison("differ", "", differences=(d,)), model)


def test_a_relative_number_is_multiplied():
    done = _corrected(_difference("Izz", 0.05, 0.06, relative=True))
    assert done.parameters.yaw_inertia == pytest.approx(1.2 * NOMINAL.yaw_inertia)
    (entry,) = done.corrections
    assert (entry.entry, entry.before) == ("yaw_inertia", "0.071")
    assert entry.recordings == "0.0852 (0.0767 to 0.0937)"  # 90 to 110 % of 0.0852
    assert (entry.reason, entry.unit) == ("Izz: another number", "kg m^2")


def test_numbers_become_entries():
    done = _corrected(_difference("C", 30.0, 33.0, relative=True)).parameters
    assert done.front_cornering_stiffness == pytest.approx(1.1 * NOMINAL.front_cornering_stiffness)
    assert done.rear_cornering_stiffness == pytest.approx(1.1 * NOMINAL.rear_cornering_stiffness)
    done = _corrected(_difference("cg_to_front_axle", 0.20, 0.21)).parameters
    assert done.cg_to_front_axle == pytest.approx(NOMINAL.cg_to_front_axle + 0.01)
    whole = NOMINAL.cg_to_front_axle + NOMINAL.cg_to_rear_axle
    assert done.cg_to_front_axle + done.cg_to_rear_axle == pytest.approx(whole), "the wheelbase is kept"
    assert _corrected(_difference("servo_lag", 0.05, 0.0)).parameters.servo_lag == 0.0  # never negative
    done = _corrected(_difference("imu_z", 0.0, 0.01, kind="instrument")).parameters
    assert done.imu_position[2] == pytest.approx(
        NOMINAL.imu_position[2] - 0.01
    )  # up, against the plant's axis


def test_a_bend_changes_by_the_ratio_of_what_shows_of_it():
    """At small slip angles little of the tyres' bend shows, on both sides."""
    rover = replace(NOMINAL, friction=0.9)
    done = _corrected(_difference("tyre_bend", 0.9, 0.225), rover).parameters
    assert done.friction == pytest.approx(1.8)


def test_a_friction_has_the_interval_of_its_bend():
    """Friction falls where bend rises."""
    (entry,) = _corrected(_difference("tyre_bend", 0.0, 3.0)).corrections
    shown, low, high = (float(part) for part in re.findall(r"[0-9.]+[0-9]", entry.recordings))
    assert shown == pytest.approx(float(entry.after), rel=1e-2)
    assert low < shown < high < 1.3 * low


def test_physics_that_was_left_out_is_added_and_what_is_too_much_is_removed():
    d = _difference("tyre_relaxation", 0.001, 0.2, kind="left out", parameter="sigma")
    done = _corrected(d, effects=("tyre_relaxation",), x={"tyre_relaxation.sigma": 0.2})
    assert done.parameters.effects["tyre_relaxation"]["sigma"] == pytest.approx(0.2)
    assert done.corrections[0].before == ""
    rover = replace(NOMINAL, effects={"steering_backlash": {"b": 0.01}})
    d = _difference("steering_backlash", 0.01, 0.0001, kind="too much", parameter="b")
    assert _corrected(d, rover).parameters.effects == {}


def test_an_effect_that_no_diagnosis_named_is_added_as_found():
    d = _difference("steering_asymmetry", 0.0, 0.06, kind="left out", parameter="e")
    assert _corrected(d).parameters.effects == {"steering_asymmetry": {"e": 0.06}}
    other = _difference("yaw_damping", 0.0, 6.0, kind="left out", parameter="c")  # 1/s here, N m s there
    assert not _corrected(other).corrections


@pytest.mark.parametrize(
    ("effect", "parameter", "own", "simulation", "recordings", "expected"),
    [
        ("tyre_relaxation", "sigma", 0.10, 0.12, 0.22, 0.20),
        ("servo_rate_limit", "R", 2.0, 2.2, 1.5, 1.0 / (1 / 2.0 + 1 / 1.5 - 1 / 2.2)),  # by its inverse
    ],
)
def test_an_effect_of_another_size_moves_by_the_difference(
    effect, parameter, own, simulation, recordings, expected
):
    """The simulation's own value moves, so that a bias of the common model cancels."""
    rover = replace(NOMINAL, effects={effect: {parameter: own}})
    d = _difference(effect, simulation, recordings, kind="size", parameter=parameter)
    assert _corrected(d, rover).parameters.effects[effect][parameter] == pytest.approx(expected)


def test_what_the_rover_cannot_have_is_said_and_left():
    done = _corrected(_difference("vy_gain", 0.0, 0.2, kind="instrument"))
    assert not done.corrections
    assert "cannot have a wrong scale of the estimator's V_y" in done.left[0]
    impossible = _corrected(_difference("k_phi", 10.0, 0.1, relative=True))
    assert not impossible.corrections and impossible.left
    assert impossible.parameters == NOMINAL


def test_the_variant_file_gives_the_same_rover(tmp_path):
    rover = replace(NOMINAL, yaw_inertia=0.08, effects={"tyre_relaxation": {"sigma": 0.2}})
    done = _corrected(_difference("Izz", 0.05, 0.06, relative=True), rover)
    path = tmp_path / "variant.toml"
    path.write_text(variant_with_reasons(done.parameters, done.corrections, "nominal"), encoding="utf-8")
    again = load_variant(path)
    assert again.yaw_inertia == pytest.approx(done.parameters.yaw_inertia)
    assert again.effects == done.parameters.effects
    assert "# was 0.08: Izz: another number" in path.read_text(encoding="utf-8")
