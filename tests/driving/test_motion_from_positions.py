"""Motion that no sensor gives directly: of GPS, of a phone in any orientation, of revolutions, in reverse."""

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

import rover_sweep as rs
from rover_sweep.data.recording import Array
from rover_sweep.driving.consistency import with_slope
from rover_sweep.errors import DataRefused
from rover_sweep.logs.read import read_logs
from rover_sweep.logs.readers.guessed_columns import ColumnGuess, guess_columns
from rover_sweep.logs.readers.tables import read_table

WHEELBASE, FINE = 0.33, 200
LAT, LON, DEGREE = 48.1, 11.5, 111_319.5


def driven(hz: float = 50.0, way: float = 1.0, seconds: float = 60.0) -> dict[str, Array]:
    """A car without slip: steering [rad] about a trim, speed (below 0 in reverse), yaw rate, position."""
    rng = np.random.default_rng(7)
    t = np.arange(0, seconds, 1 / FINE)
    delta = 0.2 * np.sin(0.9 * t) * np.sin(0.13 * t + 1) + 0.08 * np.sin(2.7 * t)
    v = way * (1.8 + 0.7 * np.sin(0.4 * t) * np.sin(0.07 * t))
    share = np.exp(-1 / FINE / 0.12)
    r = v / WHEELBASE * lfilter([1 - share], [1, -share], delta)
    psi = np.cumsum(r) / FINE
    x, y = (np.cumsum(v * f(psi)) / FINE for f in (np.cos, np.sin))
    whole = {"t": t, "delta": delta + 0.02, "v": v, "r": r, "ay": v * r, "ax": np.gradient(v, t)}
    step = round(FINE / hz)
    found = {name: c[::step] for name, c in (whole | {"psi": psi, "x": x, "y": y}).items()}
    noise = {"v": 0.01, "r": 0.01, "ay": 0.1, "ax": 0.1}
    return {n: c + noise.get(n, 0.0) * rng.standard_normal(c.size) for n, c in found.items()}


def written(path: Path, **columns: Array) -> Path:
    rows = np.column_stack(list(columns.values()))
    np.savetxt(path, rows, delimiter=",", header=",".join(columns), comments="", fmt="%.10g")
    return path


def guessed(path: Path) -> ColumnGuess:
    return guess_columns(read_table([path]))


def degrees_of(d: dict[str, Array], noise: float = 0.0) -> dict[str, Array]:
    rng = np.random.default_rng(1)
    east, north = (d[n] + noise * rng.standard_normal(d[n].size) for n in ("x", "y"))
    lon = LON + east / DEGREE / np.cos(np.radians(LAT))
    return {"lat": LAT + north / DEGREE, "lon": lon}


@pytest.mark.parametrize("scale", [1.0, 1e7], ids=["degrees", "1e-7 degrees"])
def test_latitude_and_longitude_give_speed_and_yaw_rate(scale: float, tmp_path: Path) -> None:
    d = driven(10)
    place = {name: np.round(scale * x, 7) for name, x in degrees_of(d, 0.005).items()}
    path = written(tmp_path / "gps.csv", t=d["t"], steering=d["delta"], **place)
    found = guessed(path)
    assert found.map["speed"]["lat_lon"] == found.map["r"]["lat_lon"] == ["lat", "lon"]
    assert "no gyro and no heading was found" in found.text()
    (log,) = read_logs(str(path))
    for channel, key, error in (("speed", "v", 0.05), ("r", "r", 0.12)):
        true = np.interp(log.signals[channel].t, d["t"], d[key])
        assert float(np.std(log.signals[channel].x - true)) < error, channel
    answer = rs.identify_driving(path)
    assert answer.numbers["wheelbase_seen"].value == pytest.approx(WHEELBASE, rel=0.05)
    assert "response_time" not in answer.numbers and answer.level == "rough"
    assert any("Record a gyro" in words for words in answer.unknown)


def test_positions_written_again_at_the_rate_of_the_gyro_count_once(tmp_path: Path) -> None:
    d = driven(100)
    for every, name in ((20, "five"), (100, "one")):
        held = {n: np.repeat(x[::every], every)[: x.size] for n, x in degrees_of(d).items()}
        path = written(tmp_path / f"{name}.csv", t=d["t"], steering=d["delta"], yaw_rate=d["r"], **held)
        if name == "one":
            with pytest.raises(DataRefused, match="come every 1 s, too seldom for a speed in turns"):
                rs.identify_driving(path)
        else:
            answer = rs.identify_driving(path)
            assert answer.numbers["wheelbase_seen"].value == pytest.approx(WHEELBASE, rel=0.05)
            assert answer.numbers["response_time"].value == pytest.approx(0.12, abs=0.03)


def test_positions_too_coarse_for_a_yaw_rate_are_said(tmp_path: Path) -> None:
    d = driven(1)
    path = written(tmp_path / "phone.csv", t=d["t"], steering=d["delta"], **degrees_of(d, 2.0))
    found = guessed(path)
    assert "yaw rate" in found.missing and "the positions are too coarse" in found.text()


def test_a_phone_in_any_orientation(tmp_path: Path) -> None:
    d = driven()
    turned, _ = np.linalg.qr(np.random.default_rng(4).standard_normal((3, 3)))
    turned *= np.sign(np.linalg.det(turned))
    gyro = turned @ np.stack((0 * d["r"], 0 * d["r"], d["r"]))
    acc = turned @ np.stack((d["ax"], d["ay"], 9.81 + 0.1 * np.sin(50 * d["t"])))
    columns = {f"gyro {'xyz'[k]}": gyro[k] for k in range(3)} | {f"acc {'xyz'[k]}": acc[k] for k in range(3)}
    path = written(tmp_path / "phone.csv", t=d["t"], servo=1500 + 600 * d["delta"], speed=d["v"], **columns)
    found = guessed(path)
    assert found.map["r"]["columns"] == ["gyro x", "gyro y", "gyro z"]
    assert found.map["r"]["along"] == pytest.approx(turned @ [0, 0, 1], abs=0.03)
    assert found.map["ay"]["along"] == pytest.approx(turned @ [0, 1, 0], abs=0.05)
    assert "gravity's mean direction is up" in found.text()
    answer = rs.identify_driving(path)
    assert answer.level == "good"
    assert answer.numbers["curvature"].value == pytest.approx(100 / 600 / WHEELBASE, rel=0.03)


def test_a_flat_sensor_is_left_as_it_is(tmp_path: Path) -> None:
    d = driven()
    names = {"gyro_x": 0.01 * d["ax"], "gyro_y": 0.01 * d["ay"], "gyro_z": d["r"]}
    acc = {"acc_x": d["ax"], "acc_y": d["ay"], "acc_z": 9.81 + 0.01 * d["ax"]}
    path = written(tmp_path / "imu.csv", t=d["t"], steering=d["delta"], speed=d["v"], **names, **acc)
    found = guessed(path).map
    assert found["r"] == "gyro_z" and found["ay"] == "acc_y"


@pytest.mark.parametrize(
    ("more", "words", "trim"),
    [
        ({"ay": "ay"}, "by the sign of a_y and of the steering, driven in reverse", 0.02),
        ({"x": "x", "y": "y", "yaw": "psi"}, "heading points against the course: driven in reverse", 0.02),
    ],
    ids=["a_y", "heading"],
)
def test_a_drive_in_reverse_is_found(more: dict[str, str], words: str, trim: float, tmp_path: Path) -> None:
    d = driven(way=-1.0)
    columns = {name: d[key] for name, key in more.items()}
    path = written(tmp_path / "back.csv", t=d["t"], steering=d["delta"], gz=d["r"], speed=d["v"], **columns)
    found = guessed(path)
    assert words in found.text() and found.map["speed"] == "speed" and found.map["delta"] == "steering"
    numbers = rs.identify_driving(path).numbers
    assert numbers["wheelbase_seen"].value == pytest.approx(WHEELBASE, rel=0.03)
    assert numbers["straight"].value == pytest.approx(trim, abs=0.003)


def test_a_sign_of_the_speed_that_nothing_decides_is_said(tmp_path: Path) -> None:
    d = driven(way=-1.0)
    path = written(tmp_path / "back.csv", t=d["t"], pwm=1500 + 600 * d["delta"], gz=d["r"], v=d["v"])
    found = guessed(path)
    assert "nothing in the file says whether that is reverse or a wrong sign" in found.text()
    assert found.map["speed"] == {"column": "v", "scale": -1}


def test_revolutions_are_scaled_by_positions_or_by_a_y(tmp_path: Path) -> None:
    d = driven()
    given = {"t": d["t"], "steering": d["delta"], "gz": d["r"], "motor_rpm": d["v"] / 0.004}
    by_place = guessed(written(tmp_path / "place.csv", **given, x=d["x"], y=d["y"]))
    assert by_place.map["speed"]["scale"] == pytest.approx(0.004, rel=0.02)
    assert "scaled by the position's slope: 0.004" in by_place.text() and not by_place.unsure
    by_ay = guessed(written(tmp_path / "ay.csv", **given, ay=d["ay"]))
    assert by_ay.map["speed"]["scale"] == pytest.approx(0.004, rel=0.05) and by_ay.unsure == ("speed",)
    alone = guessed(written(tmp_path / "alone.csv", **given))
    assert alone.missing == ("speed",) and "motor_rpm are revolutions" in alone.text()


def test_a_normalised_steering_is_shown_in_its_unit(tmp_path: Path) -> None:
    d = driven()
    steering = d["delta"] / np.max(np.abs(d["delta"]))
    path = written(tmp_path / "joy.csv", t=d["t"], steering=steering, gz=d["r"], speed=d["v"])
    answer = rs.identify_driving(path)
    assert answer.numbers["straight"].unit == "of full steering"
    page = answer.report(tmp_path / "out")
    assert '"steering_unit": "of full steering"' in page.document.read_text()
    assert "rad," not in page.page.read_text()


def test_stamps_that_run_backwards_are_one_message(tmp_path: Path) -> None:
    d = driven()
    t = np.where(d["t"] > 40, d["t"] - 40, d["t"])
    path = written(tmp_path / "two.csv", t=t, steering=d["delta"], gz=d["r"], speed=d["v"])
    with pytest.raises(
        DataRefused, match=r"times of column t.*first in row 2002, from 40.00 to 0.02 s.*split"
    ):
        rs.identify_driving(path)


def trials(path: Path, early: dict[int, float], noise: tuple[int, ...] = ()) -> Path:
    """Four trials of 15 s, some of whose steering is early [s] or of another drive."""
    d = driven()
    number = np.minimum(d["t"] // 15, 3)
    delta, rng = d["delta"].copy(), np.random.default_rng(5)
    for k, seconds in early.items():
        delta[number == k] = np.interp(d["t"][number == k] + seconds, d["t"], d["delta"])
    for k in noise:
        delta[number == k] = rng.permutation(delta[number == k])
    return written(path, t=d["t"], trial=number, steering=delta, gz=d["r"], speed=d["v"])


def test_a_run_whose_steering_has_another_clock_is_moved(tmp_path: Path) -> None:
    right = rs.identify_driving(trials(tmp_path / "right.csv", {}))
    moved = rs.identify_driving(trials(tmp_path / "early.csv", {2: 0.9}))
    assert re.search(r"early 2: its steering is 0.(88|9|92) s early against the other runs", str(moved))
    assert "against the other runs" not in str(right)
    for name, error in (("wheelbase_seen", 0.01), ("response_time", 0.04)):
        assert moved.numbers[name].value == pytest.approx(right.numbers[name].value, abs=error), name


def test_a_run_of_another_drive_is_left_out(tmp_path: Path) -> None:
    answer = rs.identify_driving(trials(tmp_path / "other.csv", {}, noise=(1,)))
    assert "other 1 was left out: unlike in the other runs, the yaw rate does not follow" in str(answer)
    assert answer.numbers["wheelbase_seen"].value == pytest.approx(WHEELBASE, rel=0.03)


def test_wheels_that_spin_are_left_out(tmp_path: Path) -> None:
    d = driven()
    spin = ((d["t"] % 15 > 5) & (d["t"] % 15 < 7) & (np.abs(d["ay"]) > 1.0)).astype(float)
    path = written(
        tmp_path / "spin.csv",
        t=d["t"],
        steering=d["delta"],
        gz=d["r"],
        ay=d["ay"],
        speed=d["v"] * (1 + 0.8 * spin),
    )
    answer = rs.identify_driving(path)
    out = answer.driving.left_out["the wheels spin, as the speed is far above a_y/r"]
    assert 0.3 * spin.sum() / 50 < out < 2 * spin.sum() / 50
    assert answer.numbers["wheelbase_seen"].value == pytest.approx(WHEELBASE, rel=0.04)


def test_ground_that_slopes_is_said(tmp_path: Path) -> None:
    d = driven()
    given = {"t": d["t"], "steering": d["delta"], "gz": d["r"], "speed": d["v"], "yaw": d["psi"]}
    sloping = d["ay"] + 9.81 * np.sin(np.radians(4)) * np.sin(d["psi"])
    for ay, said in ((sloping, True), (d["ay"], False)):
        (log,) = read_logs(str(written(tmp_path / "bank.csv", **given, ay=ay)))
        assert any("as on a slope of 4." in note.text for note in with_slope(log).notes) == said
