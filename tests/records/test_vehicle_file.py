"""The vehicle file: what is read, every mistake reported at once, comments kept when it is written."""

from __future__ import annotations

from dataclasses import replace
from math import hypot
from pathlib import Path

import pytest

from rover_sweep.data.geometry import Tolerances
from rover_sweep.data.vehicle_file import Measured, example, load, parse, set_numbers
from rover_sweep.data.vehicle_geometry import tolerances_of, with_uncertainties
from rover_sweep.data.vehicle_rules import MATERIAL
from rover_sweep.errors import UsageError

DATA = Path(__file__).parents[1] / "data"
MINIMAL = "[vehicle]\nmass = 2.66\ncg_to_front_axle = 0.203\ncg_to_rear_axle = 0.188\n"


def refusal(text: str) -> str:
    with pytest.raises(UsageError) as caught:
        parse(text, "my.toml")
    return str(caught.value)


def test_example_is_read_whole() -> None:
    rover = parse(example())
    assert rover.mass == Measured(2.66, 0.005)
    assert rover.wheelbase == pytest.approx(0.391)
    assert rover.roll_inertia == Measured(0.0125, 0.001)
    assert rover.sprung_mass == Measured(2.40)
    assert rover.steering() == (1500.0, 0.00095)
    assert rover.imu_iso == (0.0, 0.0, -0.058)
    assert rover.free == ()
    assert [rover.missing_for(m) for m in ("bicycle", "roll-yaw", "lumped")] == [(), (), ()]


def test_committed_rover_toml_is_the_example() -> None:
    assert (DATA / "rover.toml").read_text(encoding="utf-8") == example()


def test_minimal_file_serves_the_bicycle_and_says_what_roll_yaw_needs() -> None:
    rover = parse(MINIMAL)
    rover.require("bicycle")
    with pytest.raises(UsageError, match="sprung_mass = 2.40") as caught:
        rover.require("roll-yaw")
    assert all(key in str(caught.value) for key in ("cg_height_above_roll_centre", "roll_inertia"))
    with pytest.raises(UsageError, match="rad_per_us = "):
        rover.steering()


def test_free_and_sd_inside_position() -> None:
    text = MINIMAL + "yaw_inertia = 0.07\n[imu]\nposition = [0.02, {value = -0.01, sd = 0.003}, 0]\n"
    rover = parse(text + '[fit]\nfree = ["yaw_inertia"]\n')
    assert rover.free == ("yaw_inertia",)
    assert rover.imu_position == (Measured(0.02), Measured(-0.01, 0.003), Measured(0.0))
    assert rover.imu_iso == (0.02, 0.01, 0.0)


def test_material_sizes_of_the_example_are_the_defaults() -> None:
    sizes = parse(example()).material
    assert sizes == pytest.approx({key: MATERIAL[key].default for key in sizes})
    assert parse(MINIMAL).material == {}
    assert tolerances_of(parse(MINIMAL)) == replace(Tolerances(), imu_z=0.02)  # no h: no doubt of the axis


def test_material_sizes_become_the_spread() -> None:
    stated = parse(MINIMAL + "[material]\nservo_lag = 0.012\ncg_position = 0.004\nimu_position = 0.02\n")
    found = tolerances_of(stated)
    assert found.lag == 0.012
    assert [0.391 * x for x in (found.cg, found.imu_x, found.imu_z)] == pytest.approx([0.002, 0.01, 0.01])


WHOLE = (
    MINIMAL + "cg_height_above_roll_centre = 0.058\nroll_inertia = 0.0125\nyaw_inertia = 0.07\n"
    "[steering]\ntrim_us = 1500\nrad_per_us = -0.001\n[imu]\nposition = [0, 0, 0]\n"
)


@pytest.mark.parametrize("times", [0.4, 1.0, 6.0])
def test_defaults_scale_with_the_vehicle(times: float) -> None:
    rover = parse(WHOLE)
    assert rover.cg_height_above_roll_centre and rover.imu_position
    alike = replace(
        rover,
        **{
            name: Measured(times * getattr(rover, name).value)
            for name in ("cg_to_front_axle", "cg_to_rear_axle", "cg_height_above_roll_centre")
        },
    )
    found, wheelbase = tolerances_of(alike), times * 0.391
    least = max(0.02, 0.005 / wheelbase)  # of the IMU, 5 mm
    assert (found.scale, found.h, found.roll_inertia) == pytest.approx((0.03, 0.30, 0.15))
    assert (found.cg, found.imu_x) == pytest.approx((0.02, least))
    assert found.imu_z == pytest.approx(hypot(least, 0.30 * 0.058 / 0.391))  # h is in doubt, and so the axis


def test_what_the_owner_wrote_wins() -> None:
    """sd and how before [material], [material] before the defaults; `how` says which."""
    text = WHOLE.replace("0.203", '{ value = 0.203, how = "scale" }')
    text = text.replace("-0.001", "{ value = -0.001, sd = 0.0 }")
    text = text.replace("= [0, 0, 0]", "= { value = [0, 0, 0.01], sd = [0.001, 0.002, 0.003] }")
    rover = parse(text + "[material]\ncg_position = 0.1\nroll_inertia_share = 0.1\nimu_position = 0.1\n")
    found = tolerances_of(rover)
    assert (found.cg, found.roll_inertia) == pytest.approx((0.00203 / 0.391, 0.05))
    assert found.scale == 1e-3  # an exact number is still a number with a prior
    assert found.imu_x == pytest.approx(0.001 / 0.391)
    assert found.imu_z == pytest.approx(hypot(0.003, 0.30 * 0.058) / 0.391)
    full = with_uncertainties(rover)
    assert full.cg_to_front_axle == Measured(0.203, pytest.approx(0.00203), "scale")
    assert full.cg_to_rear_axle == Measured(0.188, 0.05, "[material]")
    assert full.mass == Measured(2.66, pytest.approx(0.0266), "default")
    assert full.imu_position == (Measured(0.0, 0.001), Measured(0.0, 0.002), Measured(0.01, 0.003))


def test_one_way_for_the_whole_position() -> None:
    rover = parse(WHOLE.replace("= [0, 0, 0]", '= { value = [0, 0, 0.05], how = "ruler" }'))
    assert rover.imu_position is not None
    assert {m.how for m in rover.imu_position} == {"ruler"}
    assert [m.sd for m in rover.imu_position] == pytest.approx([0.02 * 0.391] * 3)


MISTAKES = {
    "material, unknown": (MINIMAL + "[material]\nservo_lagg = 0.02", "did you mean servo_lag?"),
    "material, negative": (MINIMAL + "[material]\nservo_lag = -1", "above 0 and at most 0.5 s, as in"),
    "material, percent": (MINIMAL + "[material]\nsteering_scale = 3", "at most 0.5, as in: steering_scale"),
    "material, words": (MINIMAL + "[material]\nservo_lag = '40 ms'", "servo_lag is '40 ms'; it must be"),
    "material, true": (MINIMAL + "[material]\nservo_lag = true", "[material] servo_lag is True; it must be"),
    "unknown key, near": (MINIMAL + "spung_mass = 2.4", "did you mean sprung_mass?"),
    "symbol of the paper": (MINIMAL + "Izz = 0.07", "did you mean yaw_inertia?"),
    "key of another section": (MINIMAL + "rad_per_us = 0.00095", "belongs under [steering]"),
    "key outside a section": ("mass = 2.66\n" + MINIMAL, "mass is outside a section; it belongs"),
    "unknown section": (MINIMAL + "[sterring]\ntrim_us = 1500", "did you mean [steering]?"),
    "text for a number": (MINIMAL.replace("2.66", '"2.66"'), "'2.66' in quotes; it must be a plain number"),
    "negative mass": (MINIMAL.replace("2.66", "-2.66"), "mass is -2.66 kg; it must be above 0"),
    "sprung above mass": (MINIMAL + "sprung_mass = 2.7", "sprung_mass 2.7 kg is above mass 2.66 kg"),
    "grams": (MINIMAL.replace("2.66", "2660"), "grams? give kg"),
    "centimetres": (MINIMAL.replace("0.203", "20.3").replace("0.188", "18.8"), "wheelbase of 39.1 m"),
    "one in centimetres": (MINIMAL.replace("0.203", "20.3"), "centimetres or millimetres? give metres"),
    "h in centimetres": (MINIMAL + "cg_height_above_roll_centre = 5.8", "centimetres? give metres"),
    "imu in centimetres": (MINIMAL + "[imu]\nposition = [0, 0, 5.8]", "is outside the vehicle"),
    "inertia in kg cm^2": (MINIMAL + "yaw_inertia = 710", "kg cm^2 or g m^2? give kg m^2"),
    "degrees per us": (MINIMAL + "[steering]\ntrim_us = 1500\nrad_per_us = 0.0544", "1558 deg at 500 us"),
    "hardly any steering": (MINIMAL + "[steering]\ntrim_us = 1500\nrad_per_us = 1e-6", "only 0.029 deg"),
    "trim as offset": (MINIMAL + "[steering]\ntrim_us = 12\nrad_per_us = 0.001", "outside 800..2200 us"),
    "missing key": (MINIMAL.replace("mass = 2.66\n", ""), "mass is missing; add a line such as: mass = 2.66"),
    "half a steering": (MINIMAL + "[steering]\ntrim_us = 1500", "rad_per_us is missing; add a line such as"),
    "sd in percent": (MINIMAL.replace("0.203", "{value = 0.203, sd = 2}"), "sd is in m, not percent"),
    "sd of a height in mm": (
        MINIMAL + "cg_height_above_roll_centre = {value = 0.058, sd = 10}",
        "sd is 10 m; millimetres or centimetres?",
    ),
    "sd of a gain": (
        MINIMAL + "[steering]\ntrim_us = 1500\nrad_per_us = {value = -0.0009, sd = 0.01}",
        "sd 0.01 is above the value",
    ),
    "sd negative": (MINIMAL.replace("2.66", "{value = 2.66, sd = -0.1}"), "sd is -0.1"),
    "sd alone": (MINIMAL.replace("2.66", "{sd = 0.1}"), "has no value; write { value = .., sd = .. }"),
    "how, unknown": (MINIMAL.replace("2.66", '{value = 2.66, how = "eyes"}'), "how is 'eyes'; write one of"),
    "how and sd": (MINIMAL.replace("2.66", '{value = 2.66, sd = 0.1, how = "scale"}'), "has sd and how"),
    "ruler for a mass": (MINIMAL.replace("2.66", '{value = 2.66, how = "ruler"}'), "which is for lengths"),
    "share of nothing": (MINIMAL + 'roll_yaw_inertia = {value = 0, how = "guess"}', "write sd = .."),
    "position on scales": (
        MINIMAL + '[imu]\nposition = {value = [0, 0, 0.05], how = "scale"}',
        '[imu] position: how = "scale" is a share',
    ),
    "position of two": (MINIMAL + "[imu]\nposition = [0, 0.05]", "three numbers [forward, right, down]"),
    "free unknown": (MINIMAL + '[fit]\nfree = ["C_f"]', "free contains 'C_f'; it may contain mass"),
    "free without value": (
        MINIMAL + '[fit]\nfree = ["roll_inertia"]',
        "has no roll_inertia as its starting value",
    ),
    "decimal comma": (MINIMAL.replace("2.66", "2,66"), "write decimals with a point: mass = 2,66"),
    "unit after number": (MINIMAL.replace("2.66", "2.66 kg"), "write the number without its unit"),
    "empty": ("", "mass is missing"),
}


@pytest.mark.parametrize("case", MISTAKES)
def test_each_mistake_is_said_once(case: str) -> None:
    text, sentence = MISTAKES[case]
    said = refusal(text)
    assert sentence in said
    assert said.startswith("my.toml")
    assert "problems:" not in said or case in ("empty", "half a steering")


def test_all_problems_at_once() -> None:
    said = refusal(MINIMAL.replace("2.66", "-1") + "spung_mass = 2\n[steering]\ntrim_us = 15\n")
    assert said.startswith("my.toml has 4 problems:")
    assert said.count("\n  - ") == 4


def test_a_file_that_is_missing_or_no_text(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="vehicle --example"):
        load(tmp_path / "none.toml")
    path = tmp_path / "log.BIN"
    path.write_bytes(b"\xa3\x95\x80\x80\xff")
    with pytest.raises(UsageError, match="cannot be read"):
        load(path)


def test_writing_changes_one_number_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "rover.toml"
    path.write_text(example(), encoding="utf-8")
    rover = set_numbers(path, {"vehicle.yaw_inertia": Measured(0.0712, 0.0008)})
    assert rover.yaw_inertia == Measured(0.0712, 0.0008) == load(path).yaw_inertia
    before, after = example().splitlines(), path.read_text(encoding="utf-8").splitlines()
    changed = [(old, new) for old, new in zip(before, after, strict=True) if old != new]
    assert len(changed) == 1
    assert changed[0][1].startswith("yaw_inertia = { value = 0.0712, sd = 0.0008 }")
    assert changed[0][1].split("#")[1] == changed[0][0].split("#")[1]


@pytest.mark.parametrize("encoding", ["utf-16", "utf-8-sig", "utf-8"])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_a_file_as_windows_writes_it(tmp_path: Path, encoding: str, end: str) -> None:
    """PowerShell's `rover-sweep vehicle --example > rover.toml`, and the editor of Windows."""
    path = tmp_path / "rover.toml"
    path.write_bytes(example().replace("\n", end).encode(encoding))
    assert load(path) == parse(example())
    set_numbers(path, {"vehicle.mass": Measured(3.0)})
    assert load(path).mass == Measured(3.0) and path.read_bytes().count(b"\r\n") == (
        0 if end == "\n" else example().count("\n")
    )


@pytest.mark.parametrize(
    "text",
    [
        MINIMAL,
        MINIMAL + "\n[vehicle.yaw_inertia]\nvalue = 0.05\nsd = 0.01\n",
        MINIMAL + "yaw_inertia = 0.05\n",
    ],
)
def test_writing_adds_or_replaces(tmp_path: Path, text: str) -> None:
    path = tmp_path / "rover.toml"
    path.write_text(text, encoding="utf-8")
    set_numbers(path, {"vehicle.yaw_inertia": Measured(0.07, 0.002)})
    set_numbers(path, {"vehicle.roll_inertia": Measured(0.0125)})
    rover = load(path)
    assert (rover.yaw_inertia, rover.roll_inertia) == (Measured(0.07, 0.002), Measured(0.0125))
    assert rover.mass == Measured(2.66)


def test_writing_nonsense_leaves_the_file_alone(tmp_path: Path) -> None:
    path = tmp_path / "rover.toml"
    path.write_text(example(), encoding="utf-8")
    with pytest.raises(UsageError, match="give kg m\\^2"):
        set_numbers(path, {"vehicle.yaw_inertia": Measured(710.0)})
    assert path.read_text(encoding="utf-8") == example()
    assert [p.name for p in tmp_path.iterdir()] == ["rover.toml"]
