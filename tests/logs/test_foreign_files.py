"""Files of other systems, written by the libraries that such systems use, and the columns found in them."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.io import savemat
from scipy.signal import lfilter

import rover_sweep as rs
from rover_sweep.cli.main import cli
from rover_sweep.data.recording import Array
from rover_sweep.errors import DataRefused, UsageError
from rover_sweep.logs.read import read_logs
from rover_sweep.logs.readers.column_lines import FoundColumn
from rover_sweep.logs.readers.date_times import seconds_of
from rover_sweep.logs.readers.guessed_columns import ColumnGuess, guess_columns
from rover_sweep.logs.readers.tables import read_table

LENGTH, WHEELBASE, BEGAN = 60.0, 0.33, 1_650_000_000.0  # s, m, s since 1970


def drive(hz: float = 50.0) -> dict[str, Array]:
    """A car driven about by hand: steering [rad], speed, yaw rate, accelerations, heading and position."""
    rng = np.random.default_rng(3)
    t = np.arange(0, LENGTH, 1 / 200)
    delta = 0.25 * np.sin(0.9 * t) * np.sin(0.13 * t + 1) + 0.1 * np.sin(4.7 * t)
    v = 1.8 + 0.6 * np.sin(0.21 * t)
    share = np.exp(-1 / 200 / 0.12)
    r = v / WHEELBASE * lfilter([1 - share], [1, -share], delta)
    psi = np.cumsum(r) / 200
    x, y = (np.cumsum(v * f(psi)) / 200 for f in (np.cos, np.sin))
    whole = {"t": t, "delta": delta, "v": v, "r": r, "ay": v * r, "ax": np.gradient(v, t)}
    step = round(200 / hz)
    found = {name: values[::step] for name, values in (whole | {"psi": psi, "x": x, "y": y}).items()}
    noise = {"v": 0.01, "r": 0.01, "ay": 0.15, "ax": 0.1}
    return {n: c + noise.get(n, 0.0) * rng.standard_normal(c.size) for n, c in found.items()}


def written(path: Path, columns: Mapping[str, Sequence[Any] | Array], header: bool = True) -> Path:
    names = [",".join(columns)] if header else []
    rows = (",".join(str(cell) for cell in row) for row in zip(*columns.values(), strict=True))
    path.write_text("\n".join([*names, *rows]))
    return path


def as_parquet(folder: Path) -> tuple[Path, dict[str, Any]]:
    arrow, parquet = (pytest.importorskip(f"pyarrow{name}") for name in ("", ".parquet"))
    d = drive()
    stamps = arrow.array(((BEGAN + d["t"]) * 1e6).astype("int64"), arrow.timestamp("us"))
    columns = {"stamp": stamps, "steer": np.degrees(d["delta"]), "gyro_z": d["r"], "speed": d["v"]}
    parquet.write_table(arrow.table(columns), folder / "drive.parquet")
    names = {"time": "stamp", "delta": {"column": "steer", "unit": "deg"}, "r": "gyro_z", "speed": "speed"}
    return folder / "drive.parquet", names


def as_matlab(folder: Path) -> tuple[Path, dict[str, Any]]:
    d = drive()
    log = {"imu": {"wz": d["r"], "ay": d["ay"]}, "state": np.stack((d["v"], d["psi"]), 1)}
    savemat(folder / "drive.mat", {"time": d["t"], "steering": d["delta"], "log": log, "note": "a"})
    names = {"time": "time", "delta": "steering", "r": "log.imu.wz", "speed": "log.state[1]"}
    return folder / "drive.mat", names


def as_matlab_7_3(folder: Path) -> tuple[Path, dict[str, Any]]:
    pytest.importorskip("mat73")
    h5py = pytest.importorskip("h5py")
    d = drive()
    with h5py.File(folder / "new.mat", "w", userblock_size=512) as file:
        for name, key in (("time", "t"), ("steering", "delta"), ("wz", "r"), ("speed", "v")):
            file.create_dataset(name, data=d[key][None, :]).attrs["MATLAB_class"] = np.bytes_("double")
    with (folder / "new.mat").open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
    return folder / "new.mat", {"time": "time", "delta": "steering", "r": "wz", "speed": "speed"}


def as_ulog(folder: Path) -> tuple[Path, dict[str, Any]]:
    """By its specification, as the library only reads: https://docs.px4.io/main/en/dev_log/ulog_file_format."""
    pytest.importorskip("pyulog")

    def message(kind: bytes, content: bytes) -> bytes:
        return len(content).to_bytes(2, "little") + kind + content

    def north_east(d: dict[str, Array]) -> tuple[Array, ...]:
        return d["x"], -d["y"], d["v"] * np.cos(d["psi"]), -d["v"] * np.sin(d["psi"])

    out = b"ULog\x01\x12\x35\x01" + (0).to_bytes(8, "little")
    topics = (
        ("vehicle_angular_velocity", "float[3] xyz", 100.0, lambda d: (0 * d["r"], 0 * d["r"], -d["r"])),
        ("actuator_servos", "float[1] control", 50.0, lambda d: (-d["delta"] / 0.35,)),
        ("vehicle_local_position", "float x;float y;float vx;float vy", 20.0, north_east),
    )
    for name, fields, _, _ in topics:
        out += message(b"F", f"{name}:uint64_t timestamp;{fields};".encode())
    for number, (name, *_) in enumerate(topics):
        out += message(b"A", b"\x00" + number.to_bytes(2, "little") + name.encode())
    for number, (_, _, hz, columns) in enumerate(topics):
        d = drive(hz)
        for row in zip(d["t"], *columns(d), strict=True):
            stamp = int((5 + row[0]) * 1e6).to_bytes(8, "little")
            out += message(b"D", number.to_bytes(2, "little") + stamp + np.float32(row[1:]).tobytes())
    (folder / "drive.ulg").write_bytes(out)
    names: dict[str, Any] = {
        "delta": {"column": "actuator_servos.control[0]", "scale": 0.35},
        "r": "vehicle_angular_velocity.xyz[2]",
        "speed": {"velocity": ["vehicle_local_position.vx", "vehicle_local_position.vy"]},
        "axes": "frd",
    }
    return folder / "drive.ulg", names


def as_bag(kind: str, folder: Path) -> tuple[Path, dict[str, Any]]:
    """Of ROS 1 (bag) or 2 (sqlite3, mcap): an IMU, the odometry and Ackermann commands, each at its rate."""
    pytest.importorskip("rosbags")
    from rosbags import rosbag1, rosbag2
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    first = kind == "bag"
    store = get_typestore(Stores.ROS1_NOETIC if first else Stores.ROS2_HUMBLE)
    drive_text = (
        "float32 steering_angle\nfloat32 steering_angle_velocity\nfloat32 speed\nfloat32 acceleration\n"
    )
    types = get_types_from_msg(f"{drive_text}float32 jerk", "ackermann_msgs/msg/AckermannDrive")
    text = "std_msgs/Header header\nackermann_msgs/AckermannDrive drive"
    store.register(types | get_types_from_msg(text, "ackermann_msgs/msg/AckermannDriveStamped"))
    make = {
        name.rpartition("/")[2]: kind for name, kind in store.types.items() if name != "std_msgs/msg/Time"
    }
    path = folder / ("drive.bag" if first else f"drive_{kind}")
    if first:
        writer: Any = rosbag1.Writer(path)
    else:
        plugin = rosbag2.StoragePlugin.MCAP if kind == "mcap" else rosbag2.StoragePlugin.SQLITE3
        writer = rosbag2.Writer(path, version=8, storage_plugin=plugin)

    def header(t: float) -> Any:
        seconds = BEGAN + t
        stamp = make["Time"](sec=int(seconds), nanosec=int(seconds % 1 * 1e9))
        return make["Header"](**({"seq": 0} if first else {}), stamp=stamp, frame_id="base")

    def vector(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Any:
        return make["Vector3"](x=float(x), y=float(y), z=float(z))

    def turned(psi: float) -> Any:
        return make["Quaternion"](x=0.0, y=0.0, z=float(np.sin(psi / 2)), w=float(np.cos(psi / 2)))

    def imu(d: dict[str, float]) -> Any:
        none = np.zeros(9)
        turn, push = vector(z=d["r"]), vector(d["ax"], d["ay"], 9.8)
        return make["Imu"](header(d["t"]), turned(d["psi"]), none, turn, none, push, none)

    def odometry(d: dict[str, float]) -> Any:
        none = np.zeros(36)
        pose = make["Pose"](make["Point"](x=d["x"], y=d["y"], z=0.0), turned(d["psi"]))
        twist = make["Twist"](vector(x=d["v"]), vector(z=d["r"]))
        posed, twisted = make["PoseWithCovariance"](pose, none), make["TwistWithCovariance"](twist, none)
        return make["Odometry"](header(d["t"]), "base", posed, twisted)

    def command(d: dict[str, float]) -> Any:
        angles = make["AckermannDrive"](d["delta"], 0.0, d["v"], 0.0, 0.0)
        return make["AckermannDriveStamped"](header(d["t"]), angles)

    topics = (("/imu/data", "Imu", 100.0, imu), ("/odom", "Odometry", 40.0, odometry))
    topics += (("/drive", "AckermannDriveStamped", 50.0, command),)  # type: ignore[assignment]
    messages = []
    with writer:
        for topic, name, hz, build in topics:
            full = next(n for n in store.types if n.endswith(f"/{name}"))
            connection = writer.add_connection(topic, full, typestore=store)
            d = drive(hz)
            for k in range(d["t"].size):
                message = build({n: float(c[k]) for n, c in d.items()})
                raw = (store.serialize_ros1 if first else store.serialize_cdr)(message, full)
                messages.append((int((BEGAN + d["t"][k] + 0.004) * 1e9), connection, raw))
        for stamp, connection, raw in sorted(messages, key=lambda m: m[0]):
            writer.write(connection, stamp, raw)
    names = {
        "delta": "/drive.drive.steering_angle",
        "r": "/imu/data.angular_velocity.z",
        "speed": "/odom.twist.twist.linear.x",
    }
    return path, names


FORMATS: dict[str, Callable[[Path], tuple[Path, dict[str, Any]]]] = {
    "parquet": as_parquet,
    "matlab": as_matlab,
    "matlab 7.3": as_matlab_7_3,
    "ulog": as_ulog,
    "ros 1": partial(as_bag, "bag"),
    "ros 2": partial(as_bag, "sqlite3"),
    "mcap": partial(as_bag, "mcap"),
}


@pytest.mark.parametrize("kind", FORMATS)
def test_its_columns_are_found_and_its_channels_are_on_one_clock(kind: str, tmp_path: Path) -> None:
    path, names = FORMATS[kind](tmp_path)
    found = guess_columns(read_table([path])).map
    column, told = (
        {k: v.get("column", v) if isinstance(v, dict) else v for k, v in one.items()}
        for one in (names, found)
    )
    assert {k: told.get(k) for k in column} == column
    assert kind != "parquet" or found["delta"]["unit"] == "deg"
    (log,) = read_logs(str(path), column_map=names)
    d = drive(200.0)
    start = log.signals["r"].t[0]
    for signal, key in ((log.signals["r"], "r"), (log.signals["speed"], "v"), (log.steering[0], "delta")):
        true = np.interp(signal.t - start, d["t"], d[key])
        assert float(np.std(signal.x - true)) < 0.04 * float(np.std(true)) + 0.02, key


def joined(folder: Path) -> str:
    """An IMU in deg/s and g, commands and odometry: three .csv with split stamps."""
    fast, slow = drive(100.0), drive(20.0)

    def split(t: Array) -> dict[str, Array]:
        return {"s": (BEGAN + t).astype(int), "ns": ((BEGAN + t) % 1 * 1e9).astype(int)}

    flat = {"az": np.full(fast["t"].size, 1.0) + 0.02 * np.sin(fast["t"])}
    imu = {"ay": fast["ay"] / 9.81, **flat, "wz": -np.degrees(fast["r"])}
    written(folder / "imu.csv", split(fast["t"]) | imu)
    written(folder / "command.csv", split(slow["t"]) | {"steering": -slow["delta"]})
    written(folder / "odom.csv", split(slow["t"]) | {"vx": slow["v"], "x": slow["x"], "y": slow["y"]})
    return "+".join(str(folder / f"{name}.csv") for name in ("imu", "command", "odom"))


def guessed(source: str | Path) -> ColumnGuess:
    return guess_columns(read_table([Path(part) for part in str(source).split("+")]))


def test_files_of_one_drive_are_joined_and_units_and_signs_found(tmp_path: Path) -> None:
    source = joined(tmp_path)
    found = guessed(source).map
    assert found["r"] == {"column": "imu.wz", "unit": "deg/s", "scale": -1}
    assert found["ay"] == {"column": "imu.ay", "unit": "g"}
    assert found["delta"] == {"column": "command.steering", "scale": -1.0, "origin": "commanded"}
    assert found["speed"] == "odom.vx"
    assert found["time"][0] == {"column": "imu.s", "nanoseconds": "imu.ns"}
    (log,) = read_logs(source)
    d = drive(200.0)
    for signal, key in ((log.signals["r"], "r"), (log.steering[0], "delta"), (log.signals["ay"], "ay")):
        true = np.interp(signal.t - BEGAN, d["t"], d[key])
        assert np.corrcoef(signal.x, true)[0, 1] > 0.95, key
    assert any("joined by their times" in note.text for note in log.notes)
    late = tmp_path / "odom.csv"
    late.write_text(late.read_text().replace("\n1650", "\n1651"))
    with pytest.raises(DataRefused, match="recorded at no common time"):
        read_logs(source, column_map=found)


def test_a_file_without_names_is_understood_by_its_numbers(tmp_path: Path) -> None:
    d = drive()
    clock = [f"2024_04_23_11_59_{int(t):02d}_{round(t % 1 * 1000):03d}" for t in d["t"]]
    turn = np.angle(np.exp(1j * d["psi"]))
    columns = (clock, d["t"] * 30 % 7, d["delta"], d["x"], d["y"], turn, d["v"], d["r"], d["ax"])
    path = written(tmp_path / "log.csv", {str(k): c for k, c in enumerate(columns)}, header=False)
    found = guessed(path).map
    motion = {"r": "column 8", "speed": "column 7", "path_speed": {"position": ["column 4", "column 5"]}}
    assert found == {"time": "column 1", "delta": "column 3", **motion}


def test_a_heading_replaces_the_gyro_and_positions_the_speed(tmp_path: Path) -> None:
    d = drive()
    columns = {"time_ms": 1000 * d["t"], "steering_deg": np.degrees(d["delta"]), "x": d["x"], "y": d["y"]}
    path = written(tmp_path / "pose.csv", {**columns, "yaw": d["psi"]})
    found = guessed(path).map
    assert found["r"] == {"heading": "yaw"} and found["speed"] == {"position": ["x", "y"]}
    assert found["time"] == {"column": "time_ms", "unit": "ms"}
    assert found["delta"] == {"column": "steering_deg", "unit": "deg"}
    (log,) = read_logs(str(path))
    assert (
        float(np.std(log.signals["r"].x - d["r"])) < 0.05
        and float(np.std(log.signals["speed"].x - d["v"])) < 0.05
    )


def test_quaternions_mph_and_even_samples_are_read(tmp_path: Path) -> None:
    d = drive()
    parts = {"qx": 0 * d["t"], "qy": 0 * d["t"], "qz": np.sin(d["psi"] / 2), "qw": np.cos(d["psi"] / 2)}
    path = written(tmp_path / "q.csv", {"mph": d["v"] / 0.44704, "steer": d["delta"], **parts})
    columns = {
        "time": {"rate": 50},
        "r": {"quaternion": list(parts)},
        "speed": {"column": "mph", "unit": "mph"},
        "delta": "steer",
    }
    (log,) = read_logs(str(path), column_map=columns)
    assert float(np.std(log.signals["r"].x - d["r"])) < 0.05
    assert log.signals["speed"].x == pytest.approx(d["v"]) and log.signals["r"].rate == pytest.approx(50)
    with pytest.raises(UsageError, match="needs a list of 4 columns"):
        read_logs(str(path), column_map={**columns, "r": {"quaternion": ["qx", "qy"]}})


def test_what_is_not_found_is_a_comment_to_complete(tmp_path: Path) -> None:
    d = drive()
    path = written(tmp_path / "part.csv", {"t": d["t"], "yaw_rate": d["r"], "speed": d["v"]})
    out = tmp_path / "columns.toml"
    done = CliRunner().invoke(cli, ["columns", str(path), "--out", str(out)])
    assert done.exit_code == 0 and "not found: steering" in done.stderr
    assert set(tomllib.loads(out.read_text())) == {"time", "r", "speed"}
    assert '# delta = "?"' in out.read_text()
    with pytest.raises(UsageError, match="no column was found for steering; write a map"):
        read_logs(str(path))


def test_a_missing_library_is_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "pyulog", None)
    path = tmp_path / "drive.ulg"
    path.write_bytes(b"ULog")
    with pytest.raises(UsageError, match=r"a ULog file needs pyulog.*pip install -e '\.\[readers\]'"):
        read_logs(str(path))


@pytest.mark.parametrize("name", ["a.parquet", "a.mat", "a.ulg", "a.bag", "a.mcap", "a.db3"])
def test_a_damaged_file_is_refused(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(b"not what its name says" * 9)
    with pytest.raises((DataRefused, UsageError)):
        read_logs(str(tmp_path / name))


def as_a_spreadsheet_writes(folder: Path, encoding: str, preamble: str = "") -> Path:
    """Semicolons, a comma as decimal sign, German names, deg and km/h."""
    d = drive()
    columns = (d["t"], np.rad2deg(d["delta"]), 3.6 * d["v"], np.rad2deg(d["r"]))
    head = "Zeit;Lenkwinkel [°];Geschwindigkeit [km/h];Gierrate [°/s]"
    rows = (";".join(f"{x:.4f}" for x in row).replace(".", ",") for row in zip(*columns, strict=True))
    path = folder / "fahrt.csv"
    path.write_text(preamble + "\n".join([head, *rows]), encoding=encoding)
    return path


@pytest.mark.parametrize("encoding", ["utf-8", "cp1252", "utf-16"])
def test_what_a_german_spreadsheet_writes_is_read(encoding: str, tmp_path: Path) -> None:
    found = guessed(as_a_spreadsheet_writes(tmp_path, encoding))
    assert found.map["speed"] == {"column": "Geschwindigkeit [km/h]", "unit": "km/h"}
    assert found.map["r"] == {"column": "Gierrate [°/s]", "unit": "deg/s"}
    assert found.map["delta"] == {"column": "Lenkwinkel [°]", "unit": "deg"}
    assert 'unit = "km/h"' in found.text() and "°" in found.text()
    (log,) = read_logs(str(tmp_path / "fahrt.csv"))
    assert log.signals["r"].x == pytest.approx(drive()["r"], abs=1e-4)


def test_text_above_the_names_of_the_columns_is_passed_over(tmp_path: Path) -> None:
    path = as_a_spreadsheet_writes(tmp_path, "utf-8", "Logger 1.2\nDatum: 3.5.2024, 14:07\n\n")
    table = read_table([path])
    assert table.header[0] == "Zeit"
    assert [note.text for note in table.notes] == ["fahrt.csv: the names of its columns are in line 4"]


def test_numbers_that_scale_with_a_guessed_unit_are_rough(tmp_path: Path) -> None:
    d = drive()
    columns = {"t": d["t"], "steering": d["delta"], "yaw_rate (rad/s)": d["r"], "v": 3.6 * d["v"]}
    answer = rs.identify_driving(written(tmp_path / "kmh.csv", columns))
    assert answer.level == "rough" and "the unit of the speed is a guess" in answer.reasons[-1]
    assert 'delta = "steering"' in answer.read[0] and 'r = "yaw_rate (rad/s)"' in str(answer)
    named = {"v (km/h)" if name == "v" else name: x for name, x in columns.items()}
    driven = rs.identify_driving(written(tmp_path / "named.csv", named))
    assert driven.level == "good"
    assert driven.numbers["wheelbase_seen"].value == pytest.approx(WHEELBASE, rel=0.03)


def hand_made(**changed: Any) -> dict[str, Any]:
    d = drive()
    return {"t": d["t"], "steer": d["delta"] / 0.35, "speed": d["v"], "gz": d["r"]} | changed


STILL = 0 * drive()["v"]


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        ({name: column[:1] for name, column in hand_made().items()}, "only 1 row; at least 20 are needed"),
        (hand_made(steer=0.2 + STILL, gz=0.1 + STILL), "steer does not change"),
        (hand_made(speed=STILL), "the vehicle stands still: speed is 0 in all rows"),
    ],
)
def test_what_no_map_can_mend_is_said(columns: dict[str, Any], words: str, tmp_path: Path) -> None:
    with pytest.raises(DataRefused, match=words):
        read_logs(str(written(tmp_path / "drive.csv", columns)))


def test_tables_that_cannot_be_joined_or_named_are_refused(tmp_path: Path) -> None:
    twice = written(tmp_path / "drive.csv", hand_made())
    twice.write_text(twice.read_text().replace("speed", "steer", 1))
    with pytest.raises(DataRefused, match="it has 2 columns steer; rename all but one"):
        read_logs(str(twice))
    lacking = tmp_path / "lacking.csv"
    lacking.write_text("t,speed\n" + "".join(f"{n},2.0,0.1,0.2,0.3\n" for n in range(40)))
    with pytest.raises(DataRefused, match="line 2 has 5 of 2 columns"):
        read_table([lacking])


def test_what_a_guess_is_not_certain_of_is_a_comment(tmp_path: Path) -> None:
    d = drive()
    still = {"t": d["t"], "yaw_rate": d["r"], "speed": d["v"], "throttle": d["r"] + 0.1 * d["ax"]}
    for columns, words in ((still | {"steering": 0.2 + STILL}, "steering does not change"),):
        assert words in guessed(written(tmp_path / "log.csv", columns)).text()
    line = FoundColumn("speed", "v", "likely", "unit m/s, not certain", ('speed = {unit = "km/h"}',))
    assert "; the unit of speed is not certain; to correct them" in ColumnGuess("a.csv", (line,)).sentence()


def test_a_text_file_of_columns_is_read_and_others_are_refused(tmp_path: Path) -> None:
    path = written(tmp_path / "drive.txt", hand_made())
    shown = CliRunner().invoke(cli, ["identify", str(path), "--out", str(tmp_path / "out")])
    assert shown.exit_code == 0, shown.output
    assert "delta is no angle, its unit is full steering" in " ".join(shown.output.split())
    assert "rover-sweep design" not in shown.output  # it can send sweeps to ArduPilot only
    other = path.rename(tmp_path / "drive.py")
    refused = CliRunner().invoke(cli, ["columns", str(other)])
    assert "drive.py cannot be read; give a .BIN" in str(refused.exception)


@pytest.mark.parametrize(
    ("cell", "seconds"),
    [("12:00:01.5", 43201.5), ("2024-04-23T11:59:08Z", None), ("23.04.2024 11:59:08,25", None), ("14", None)],
)
def test_date_times(cell: str, seconds: float | None) -> None:
    found = seconds_of(cell)
    assert (found is None) == (cell == "14")
    if seconds:
        assert found == seconds


@pytest.mark.parametrize(
    ("stamp", "wrong"),
    [
        ("2023-02-29 10:00:{:02d}", "there is no date 2023-02-29"),
        ("2023-13-05 10:00:{:02d}", "there is no date 2023-13-05"),
        ("2023-13-13 10:00:{:02d}", "there is no date 2023-13-13"),
        ("2023-00-10 10:00:{:02d}", "there is no date 2023-00-10"),
        ("31.02.2023 10:00:{:02d}", "there is no date 31.02.2023"),
        ("2023-02-03 25:10:{:02d}", "there is no time 25:10:04"),
        ("2023-02-03 10:61:{:02d}", "there is no time 10:61:04"),
    ],
)
@pytest.mark.parametrize("command", ["columns", "coherence"])
def test_a_time_that_does_not_exist_is_refused_with_its_row(tmp_path, stamp, wrong, command):
    """From the fifth row on, as after a clock that was set wrong."""
    whole = "2023-02-03 09:59:{:02d}"
    rows = [f"{(stamp if n > 3 else whole).format(n)},{n % 7},{n % 5}" for n in range(40)]
    path = tmp_path / "drive.csv"
    path.write_text("\n".join(["time,steering,yaw_rate", *rows]), encoding="utf-8")
    shown = CliRunner().invoke(cli, [command, str(path)])
    assert isinstance(shown.exception, DataRefused), shown.exception
    said = str(shown.exception)
    assert said.startswith("drive.csv: column time has") and f"in row 5, but {wrong};" in said, said


@pytest.mark.parametrize(
    ("cell", "later", "seconds"),
    [
        ("2016-12-31 23:59:59.5", "2016-12-31 23:59:60.5", 1.0),  # a leap second
        ("2023-02-03 23:59:59", "2023-02-03 24:00:00", 1.0),
        ("2024-02-28 23:59:59", "2024-02-29 00:00:00", 1.0),
        ("12/31/2023 23:59:59", "01/01/2024 00:00:00", 1.0),
        ("23:59:59", "25:00:00", 3601.0),  # hours since a start
        ("0000-00-00 00:00:01", "0000-00-00 00:00:02", 1.0),  # a clock that was not set
    ],
)
def test_times_that_exist_are_read(cell: str, later: str, seconds: float) -> None:
    first, second = seconds_of(cell), seconds_of(later)
    assert first is not None and second is not None and second - first == seconds
