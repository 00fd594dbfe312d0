"""Variant files: what comes with the project, and every way to get one wrong."""

from __future__ import annotations

from math import isfinite
from pathlib import Path

import pytest

from rover_sweep.diagnosis.effects import every_form
from sitl.plant.effects.replaced_numbers import resolved
from sitl.plant.effects_table import PARAMETERS
from sitl.plant.variant import PlantParameters, load_variant


def test_a_file_on_a_base_needs_only_what_differs(tmp_path: Path) -> None:
    (tmp_path / "heavy.toml").write_text('base = "nominal"\nmass = 3\n')
    (tmp_path / "heavier.toml").write_text('base = "heavy.toml"\nyaw_inertia = 0.09\n')
    q = load_variant(tmp_path / "heavier.toml")
    assert (q.mass, q.yaw_inertia, q.sprung_mass) == (3.0, 0.09, 2.40)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('base = "nominal"\nmas = 3', r"unknown mas; allowed: base, mass, sprung_mass"),
        ("mass = 3", r"missing sprung_mass"),
        ('base = "nominal"\nmass = "3"', r"mass = '3' must be a finite number"),
        ('base = "nominal"\nmass = nan', r"mass = nan must be a finite number"),
        ('base = "nominal"\nmass = 0', r"mass = 0.0 must be greater than 0"),
        ('base = "nominal"\nservo_lag = -1', r"servo_lag = -1.0 must not be negative"),
        ('base = "nominal"\nsprung_mass = 9', r"sprung_mass = 9.0 kg is more than mass"),
        ('base = "nominal"\nroll_stiffness = 1', r"roll_stiffness = 1.0 .* must exceed .* 1\.37"),
        ('base = "nominal"\ntyre_shape = 3', r"tyre_shape = 3.0 must lie in 1\.\.2"),
        ('base = "nominal"\nimu_position = [0, 1]', r"imu_position = \[0, 1\] must be three numbers"),
        ('base = "nominell"', r"no variant nominell: give one of .*nominal"),
        ('base = "wrong.toml"', r"refers back to itself"),
        ("mass 3", r"not a TOML file"),
    ],
)
def test_a_wrong_entry_is_named(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "wrong.toml"
    path.write_text(text)
    with pytest.raises(ValueError, match=said):
        load_variant(path)


# ---- The table [effects] of a variant: read, inherited, refused in words; numbers that take others' places.


def variant(folder: Path, text: str) -> PlantParameters:
    path = folder / "rover.toml"
    path.write_text('base = "nominal"\n[effects]\n' + text)
    return load_variant(path)


def test_effects_stand_beside_other_numbers_and_are_inherited(tmp_path: Path) -> None:
    (tmp_path / "loose.toml").write_text(
        'base = "nominal"\nmass = 3\n[effects]\nsteering_backlash = { b = 0.012 }\nroll_steer = { e = 0.1 }\n'
    )
    (tmp_path / "looser.toml").write_text(
        'base = "loose.toml"\n[effects]\nsteering_backlash = { b = 0.02 }\n'
    )
    assert load_variant(tmp_path / "loose.toml").mass == 3.0
    assert load_variant(tmp_path / "looser.toml").effects == {
        "steering_backlash": {"b": 0.02},
        "roll_steer": {"e": 0.1},
    }


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("steering_slack = { b = 1 }", "no effect steering_slack; there are servo_lag"),
        ("steering_backlash = 0.012", r"steering_backlash = 0.012 must be a table, as in: .*\{ b = \.\. \}"),
        ("steering_backlash = { w = 1 }", "steering_backlash has no parameter w; it has b"),
        ("tyre_slip = { C = 30 }", "tyre_slip lacks Izz"),
        ("steering_backlash = { b = -0.1 }", "b = -0.1 must be at least 0"),
        ("servo_rate_limit = { R = 0 }", "R = 0 must be greater than 0"),
        ("tyre_saturation = { mu = 1e-300 }", "mu = 1e-300 must be at least 0.01"),
        ("steering_nonlinearity = { c3 = -1e6 }", "c3 = -1000000.0 must lie between -30 and 30 1/rad2"),
        ("servo_rate_limit = { R = 1e6 }", "R = 1000000.0 must be greater than 0 and at most 100000 rad/s"),
        ("imu_tilt = {}", "imu_tilt is empty: give at least one of roll, pitch, yaw"),
        ("surface_change = { ratio = 0.8 }", r"needs either t \[s\] or distance"),
        (
            'tyre_saturation = { mu = 1, form = "cubic" }',
            "'cubic' must be one of tanh, brush, \"falling peak\", knee",
        ),
        ('load_transfer = { k = 0.1, form = "brush" }', "load_transfer has no parameter form; it has k"),
        ("servo_lag = { T = 0.1, q = 1 }", 'q goes with form = "second order"'),
        ('servo_lag = { T = 0.1, form = "second order" }', 'q goes with form = "second order"'),
        ('steering_deadband = { w = 0.1, form = "full travel" }', 'give of = "command"'),
        ('surface_change = { ratio = 1, t = 0, form = "all along" }', "leave out t and distance"),
        ('surface_change = { ratio = 1, distance = 0, form = "over ten seconds" }', "needs t"),
        ('clock_offset = { T = 0.1, stream = "gyro" }', "stream = 'gyro' must be one of steering, velocity"),
    ],
)
def test_a_wrong_effect_is_named(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(ValueError, match=f"variant rover.toml: .*{said}"):
        variant(tmp_path, text)


def test_all_that_a_diagnosis_may_find_lies_within_the_limits() -> None:
    for effect in every_form().values():
        for p in effect.parameters:
            if (rule := PARAMETERS[effect.id].get(p.name)) is None:
                continue
            values = [p.value(p.low), p.value(p.high)]
            assert all(rule.low <= value <= rule.high for value in values if isfinite(value)), (effect.id, p)


def test_effects_that_are_numbers_take_their_places_once(tmp_path: Path) -> None:
    q = variant(
        tmp_path,
        "servo_lag = { T = 0.06 }\ntransport_delay = { T = 0.07 }\nvelocity_lag = { T = 0.1 }\n"
        "tyre_slip = { C = 40, Izz = 0.08 }\nfront_rear_stiffness = { ratio = 1.5 }\n"
        "imu_offset = { x = 0.05, z = 0.02 }\nroll_dof = { k_phi = 9, b_phi = 0.5 }\n",
    )
    acting = resolved(q)
    assert (acting.servo_lag, acting.servo_delay, acting.velocity_lag) == (0.06, 0.07, 0.1)
    assert (acting.front_cornering_stiffness, acting.rear_cornering_stiffness) == pytest.approx((48, 32))
    assert (acting.yaw_inertia, acting.roll_stiffness, acting.roll_damping) == (0.08, 9.0, 0.5)
    assert acting.imu_position == pytest.approx((0.05, 0.0, 0.038))
    assert resolved(acting) == acting
    turned = variant(tmp_path, "steering_scale = { s = 0.2 }")
    assert resolved(resolved(turned)).rad_per_us == pytest.approx(1.2 * turned.rad_per_us)
