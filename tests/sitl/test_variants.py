"""Variant files: what comes with the project, and every way to get one wrong."""

from __future__ import annotations

from pathlib import Path

import pytest

from sitl.plant.plant import load_variant, variant_names


def test_names_that_come_with_the_project() -> None:
    assert set(variant_names()) >= {"nominal", "paper", "slippery"}


def test_every_number_of_a_variant_has_a_comment() -> None:
    folder = Path(load_variant.__code__.co_filename).parent / "variants"
    for path in folder.glob("*.toml"):
        lines = path.read_text(encoding="utf-8").splitlines()
        bare = [line for line in lines if "=" in line.partition("#")[0] and "#" not in line]
        assert [line for line in bare if not line.startswith("base")] == [], path.name


def test_nominal_holds_the_truth_of_the_recordings() -> None:
    q = load_variant("nominal")
    assert (q.mass, q.sprung_mass, q.cg_to_front_axle, q.cg_to_rear_axle) == (2.66, 2.40, 0.203, 0.188)
    assert (q.yaw_inertia, q.roll_inertia, q.cg_height_above_roll_centre) == (0.071, 0.0125, 0.058)
    assert (q.roll_stiffness, q.roll_damping) == (10.8, 0.36)
    assert (q.front_cornering_stiffness, q.rear_cornering_stiffness, q.rad_per_us) == (31.0, 33.5, 0.00095)
    assert (q.servo_lag, q.servo_delay) == (0.022, 0.015)


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
        ('base = "nominal"\nmass = true', r"mass = True must be a finite number"),
        ('base = "nominal"\nmass = nan', r"mass = nan must be a finite number"),
        ('base = "nominal"\nmass = 0', r"mass = 0.0 must be greater than 0"),
        ('base = "nominal"\nservo_lag = -1', r"servo_lag = -1.0 must not be negative"),
        ('base = "nominal"\nsprung_mass = 9', r"sprung_mass = 9.0 kg is more than mass"),
        ('base = "nominal"\nroll_stiffness = 1', r"roll_stiffness = 1.0 .* must exceed .* 1\.37"),
        ('base = "nominal"\ntyre_shape = 3', r"tyre_shape = 3.0 must lie in 1\.\.2"),
        ('base = "nominal"\nimu_position = [0, 1]', r"imu_position = \[0, 1\] must be three numbers"),
        ('base = "nominell"', r"no variant nominell: give one of .*nominal"),
        ('base = "wrong.toml"', r"refers back to itself"),
        ("base = 3", r"base = 3 must be the name or path"),
        ("mass 3", r"not a TOML file"),
    ],
)
def test_a_wrong_entry_is_named(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "wrong.toml"
    path.write_text(text)
    with pytest.raises(ValueError, match=said):
        load_variant(path)


def test_unknown_variant_says_which_there_are() -> None:
    with pytest.raises(ValueError, match="no variant icy: give one of .*slippery"):
        load_variant("icy")
