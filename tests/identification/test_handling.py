"""Handling quantities against closed forms and hand results."""

from dataclasses import replace

import numpy as np
import pytest
from synthetic import GEOMETRY, TRUE, driven
from test_published_model import PAPER, PUBLISHED, TABLE_2, TABLE_3, at_coherence_one

from rover_sweep.data.geometry import GRAVITY
from rover_sweep.identification.fit import accuracy, evaluated
from rover_sweep.identification.handling import handling, peak_lateral_acceleration, warnings
from rover_sweep.identification.models import bicycle, kinematic, roll_yaw
from rover_sweep.manoeuvre.sweep import Sweep

BICYCLE = bicycle(PAPER).with_values(TABLE_2)
ROLL_YAW = roll_yaw(PAPER).with_values(TABLE_3)
UNDERSTEER = roll_yaw(GEOMETRY, tied=False).with_values({**TRUE, "Cf": 29.0, "Cr": 38.0})


def told(structure, speed=2.4):
    bands = {o: b for o, b in PUBLISHED.items() if o in structure.outputs}
    return handling(evaluated(structure, [at_coherence_one(structure, bands)]), speed)


@pytest.mark.parametrize(("structure", "critical"), [(BICYCLE, 5.6), (ROLL_YAW, 7.0)])
def test_the_published_rover_oversteers(structure, critical):
    found = told(structure)
    assert found.get("critical_speed") == pytest.approx(critical, abs=0.05)
    assert found.get("characteristic_speed") is None
    assert np.max(structure.poles(0.999 * found.get("critical_speed")).real) < 0
    assert np.max(structure.poles(1.001 * found.get("critical_speed")).real) > 0
    assert "not identified" in found.sentence and "b - a" in found.sentence
    assert not found.identified and not {"critical_speed", "understeer_gradient"} & set(found.told)


def test_understeer_gradient_by_hand():
    """Table 2: m (b - a)/(L C) = 2.64 (.24 - .33)/(.57 22.6) = -.018444 rad s^2/m, -10.37 deg/g."""
    found = told(BICYCLE)
    assert found["understeer_gradient"].value == pytest.approx(-0.018444, rel=1e-4)
    assert found["understeer_gradient_deg_per_g"].value == pytest.approx(-10.367, rel=1e-4)
    assert found["static_margin"].value == pytest.approx(-0.09 / (2 * 0.57))


def test_the_characteristic_speed_has_the_highest_yaw_rate_gain():
    found = told(UNDERSTEER)
    characteristic = found.get("characteristic_speed")
    gains = [told(UNDERSTEER, v).get("yaw_rate_gain") for v in characteristic * np.array([0.95, 1, 1.05])]
    assert gains[1] == max(gains)
    assert gains[1] == pytest.approx(characteristic / (2 * GEOMETRY.wheelbase))


@pytest.mark.parametrize("structure", [BICYCLE, ROLL_YAW, UNDERSTEER])
def test_steady_gains_are_those_of_the_response(structure):
    found, w = told(structure), np.array([1e-5])
    r = structure.response(w, 2.4, "r")[0].real
    assert found["yaw_rate_gain"].value == pytest.approx(r, rel=1e-6)
    assert found["lateral_acceleration_gain"].value == pytest.approx(2.4 * r, rel=1e-6)


def test_yaw_mode_of_the_bicycle_in_closed_form():
    """w^2 = Cf Cr L^2 (1 + K V^2/L)/(m Izz V^2); the sum of the poles is the trace."""
    p, v, base = BICYCLE.values, 2.4, 0.57
    found = told(BICYCLE, v)
    k = found["understeer_gradient"].value
    square = p["C"] ** 2 * base**2 * (1 + k * v**2 / base) / (p["m"] * p["Izz"] * v**2)
    trace = -2 * p["C"] / (p["m"] * v) - (0.33**2 + 0.24**2) * p["C"] / (p["Izz"] * v)
    assert found["yaw_frequency"].value == pytest.approx(np.sqrt(square))
    assert found["yaw_damping"].value == pytest.approx(-trace / (2 * np.sqrt(square)))


def test_modes_of_the_roll_yaw_model_apart():
    """With next to no sprung mass over the roll axis the roll is a pendulum on k_phi and b_phi alone."""
    lone = roll_yaw(replace(PAPER, h=1e-6)).with_values(TABLE_3 | {"b_phi": 0.1})
    found = told(lone)
    assert found["roll_frequency"].value == pytest.approx(np.sqrt(10.4 / 0.008), rel=1e-4)
    assert found["roll_damping"].value == pytest.approx(0.1 / (2 * np.sqrt(10.4 * 0.008)), rel=1e-4)
    alone = told(bicycle(PAPER).with_values({"C": TABLE_3["C"], "Izz": TABLE_3["Izz"]}))
    assert found["yaw_frequency"].value == pytest.approx(alone["yaw_frequency"].value, rel=1e-4)


def test_modes_hold_all_poles():
    found = told(ROLL_YAW)
    square = found["roll_frequency"].value ** 2 * found["yaw_frequency"].value ** 2
    assert square == pytest.approx(np.prod(ROLL_YAW.poles(2.4)).real)


def test_beyond_the_critical_speed_there_is_no_frequency():
    assert told(BICYCLE, 6.0).get("yaw_frequency") is None
    assert told(BICYCLE, 6.0)["yaw_rate_gain"].value < 0


def test_bounds_of_a_tied_model_follow_from_that_of_c():
    structure, bands = BICYCLE, {o: PUBLISHED[o] for o in ("r", "ay", "vydot")}
    found = handling(evaluated(structure, [at_coherence_one(structure, bands)]))
    of_c = accuracy(structure, [at_coherence_one(structure, bands)])[0][0] / 100
    k, critical = found["understeer_gradient"], found["critical_speed"]
    assert k.bound == pytest.approx(of_c * abs(k.value), rel=1e-4)
    assert critical.bound == pytest.approx(of_c * critical.value / 2, rel=1e-4)
    assert found["static_margin"].bound == pytest.approx(0, abs=1e-9)


def test_bounds_of_an_untied_model_by_the_covariance():
    condition = at_coherence_one(UNDERSTEER, PUBLISHED)
    fit = evaluated(UNDERSTEER, [condition])
    names = [p.name for p in UNDERSTEER.free]
    p = UNDERSTEER.values
    slope = np.zeros(len(names))
    slope[names.index("Cf")] = -p["m"] / GEOMETRY.wheelbase * p["b"] / p["Cf"] ** 2
    slope[names.index("Cr")] = p["m"] / GEOMETRY.wheelbase * p["a"] / p["Cr"] ** 2
    found = handling(fit)["understeer_gradient"]
    assert found.bound == pytest.approx(np.sqrt(slope @ fit.covariance @ slope), rel=1e-4)
    percent = 100 * np.sqrt(np.diag(fit.covariance)) / [p[n] for n in names]
    assert percent == pytest.approx(accuracy(UNDERSTEER, [condition])[0], rel=1e-6)


def test_a_model_without_tyres_has_none():
    with pytest.raises(ValueError, match="no cornering stiffness"):
        told(kinematic(PAPER))


@pytest.fixture(scope="module")
def run():
    return driven(roll_yaw(GEOMETRY).with_values(TRUE), Sweep(amplitude=120))


def test_peak_lateral_acceleration_is_that_of_the_sweep(run):
    """120 us x .001 rad/us in the dwell: V^2 delta/L at nearly neutral steer, 2.4^2 .12/.391 = 1.77."""
    assert peak_lateral_acceleration(run) == pytest.approx(1.77, rel=0.1)


@pytest.mark.parametrize(
    ("speed", "friction", "words"),
    [
        (2.4, 0.9, ()),
        (2.4, 0.2, ("friction limit",)),
        (5.0, 5.0, ("critical speed",)),
        (5.5, None, ("critical speed", "friction limit")),
        (4.3, 5.0, ()),
    ],
)
def test_warnings(run, speed, friction, words):
    """Speeds against the published bicycle's 5.56 m/s, of which 80 % are 4.45."""
    x = run["speed"].x / 2.4
    scaled = replace(run, channels={**run.channels, "speed": replace(run["speed"], x=speed * x)})
    notes = warnings(told(BICYCLE), [scaled], friction)
    assert [n.level for n in notes] == ["warning"] * len(words)
    assert all(word in n.text for n, word in zip(notes, words, strict=True))
    if friction is None:
        assert f"limit {GRAVITY * 0.5:.1f} m/s^2 (friction 0.5, assumed)" in notes[1].text


def test_no_critical_speed_no_warning_of_it(run):
    assert warnings(told(UNDERSTEER), [run], 0.9) == ()
    assert warnings(None, [run], 0.9) == ()
