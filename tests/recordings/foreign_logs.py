"""The same drives as logs of other systems: PX4's ULog, ROS bags, and .csv of six exporters.

Each writer names, orders and scales its columns as its exporter does. `steering` says what a profile records
of the steering: "us", the angle that was commanded, or the measured angle of the wheels.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.random import Generator

from tests.engines.engine import Array
from tests.foreign.plant import DT, GRAVITY
from tests.recordings.signals import Recorded

BEGAN = 1.7e9  # s since 1970
FULL_DEG = 20.0  # of the wheels, at -1 and 1 of a normalised steering
EXPORT_LATE, BURST = 37.0, 0.2  # s: of the export's clock, and the rhythm of its arrivals
NO_CLOCK, EXPORT_ONLY, REAR = "no clock", "export stamps", "rear wheels"  # flags

Columns = Sequence[tuple[str, Array]]


def stamps(drive: Recorded, at: Array, group: str) -> Array:
    """(n,) s from the begin of the log; a group of signals may have a clock that is late."""
    return at * DT + drive.late.get(group, 0.0)


# ---- Tables.


def _rows(
    path: Path, columns: Columns, above: str = "", below: str = "", separator: str = ",", decimals: int = 6
) -> None:
    """A table of numbers. above, below: text over and under the line with the names."""
    names = separator.join(name for name, _ in columns)
    table = np.stack([values for _, values in columns], 1)
    lines = []
    for row in table.tolist():
        cells = [f"{x:.{decimals}f}" if np.isfinite(x) else "" for x in row]
        line = separator.join(cells)
        lines.append(line.replace(".", ",") if separator == ";" else line)
    path.write_text(above + names + "\n" + below + "\n".join(lines) + "\n", encoding="utf-8")


def _shown(drive: Recorded, columns: Columns) -> Columns:
    """The columns under the names that a fault gives them, and with values in a unit that is not said."""
    return [(drive.names.get(name, name), x * drive.units.get(name, 1.0)) for name, x in columns]


def _with_clock(drive: Recorded, name: str, t: Array, columns: Columns) -> Columns:
    return columns if NO_CLOCK in drive.flags else [(name, t), *columns]


def plain_csv(drive: Recorded, folder: Path, rng: Generator) -> str:
    """A user's own script: SI units, ISO axes, commanded angle."""
    at = drive.rows(50.0, rng)
    x = drive.x
    columns = [
        ("steering_angle_cmd", x["command"][at]), ("yaw_rate", x["r"][at]), ("roll_rate", x["p"][at]),
        ("speed", x["wheel"][at]), ("lat_acc", x["ay"][at]), ("acc_x", x["ax"][at]),
    ]  # fmt: skip
    shown = _with_clock(drive, "time", stamps(drive, at, "all"), _shown(drive, columns))
    _rows(folder / "drive.csv", shown)
    return str(folder / "drive.csv")


def german_csv(drive: Recorded, folder: Path, rng: Generator) -> str:
    """A German data logger: semicolons, decimal commas, degrees and km/h; measured angle."""
    at = drive.rows(100.0, rng)
    x = drive.x
    columns = [
        ("Lenkwinkel [deg]", np.degrees(x["angle"][at])),
        ("Gierrate [deg/s]", np.degrees(x["r"][at])),
        ("Wankrate [deg/s]", np.degrees(x["p"][at])),
        ("Geschwindigkeit [km/h]", 3.6 * x["wheel"][at]),
        ("Querbeschleunigung [m/s^2]", x["ay"][at]),
    ]
    shown = _with_clock(drive, "Zeit [s]", stamps(drive, at, "all"), _shown(drive, columns))
    _rows(folder / "messung.csv", shown, separator=";", decimals=5)
    return str(folder / "messung.csv")


MOTEC = (
    '"Format","MoTeC CSV File",,,"Workbook",""\n"Venue","Yard",,,"Worksheet",""\n'
    '"Vehicle","Rover",,,"Vehicle Desc",""\n"Device","ADL",,,"",""\n'
    '"Log Date","01/02/2024",,,"Origin Time","0.000","s"\n"Sample Rate","50.000","Hz",,"End Time","","s"\n'
    '"Range","entire outing",,,"End Distance","0","m"\n"Beacon Markers","","","","",""\n\n\n'
)


def motec_csv(drive: Recorded, folder: Path, rng: Generator) -> str:
    """The race logger's export: lines of text, names, units, an empty line, all in quotes; measured angle."""
    at = drive.rows(50.0, rng)
    x = drive.x
    columns: list[tuple[str, Array, str]] = [
        ("Time", stamps(drive, at, "all"), "s"),
        ("Steering Angle", np.degrees(x["angle"][at]), "deg"),
        ("Ground Speed", 3.6 * x["ground"][at], "km/h"),
        ("Gyro Yaw Velocity", np.degrees(x["r"][at]), "deg/s"),
        ("Gyro Roll Velocity", np.degrees(x["p"][at]), "deg/s"),
        ("G Force Lat", x["ay"][at] / GRAVITY, "G"),
    ]
    if NO_CLOCK in drive.flags:
        columns = columns[1:]
    shown = _shown(drive, [(name, values) for name, values, _ in columns])
    names = ",".join(f'"{name}"' for name, _ in shown)
    units = ",".join(f'"{unit}"' for *_, unit in columns)
    table = np.stack([values for _, values in shown], 1).tolist()
    lines = [",".join(f'"{c:.4f}"' if np.isfinite(c) else '""' for c in row) for row in table]
    text = f"{MOTEC}{names}\n{units}\n\n" + "\n".join(lines) + "\n"
    (folder / "motec.csv").write_text(text, encoding="utf-8")
    return str(folder / "motec.csv")


def simulator_csv(drive: Recorded, folder: Path, rng: Generator) -> str:
    """CarMaker: the angle of each wheel, a row with devices and one with units under the names.

    The rear wheels move by little, by the compliance of their axle, which follows the side force.
    """
    at = drive.rows(100.0, rng)
    x = drive.x
    angle, force = x["angle"][at], x["ay"][at]
    toe = -4e-4 * force
    front = (
        []
        if REAR in drive.flags
        else [("Car.SteerAngleFL", 1.01 * angle), ("Car.SteerAngleFR", 0.99 * angle)]
    )
    rear = [("Car.SteerAngleRL", -0.003 + toe), ("Car.SteerAngleRR", 0.003 + toe)]
    if REAR in drive.flags:  # the front wheels stand where nobody looks for them
        front = [("Sensor.SAngle.VehSensor_0.Ang", angle)]
    moved = [
        ("Car.YawRate", x["r"][at]), ("Car.RollRate", x["p"][at]), ("Car.ax", x["ax"][at]),
        ("Car.ay", force), ("Car.vx", x["wheel"][at]),
    ]  # fmt: skip
    columns = _shown(drive, [*rear, *front, *moved] if REAR in drive.flags else [*front, *rear, *moved])
    units = ["rad"] * (len(front) + 2) + ["rad/s", "rad/s", "m/s^2", "m/s^2", "m/s"]
    if NO_CLOCK not in drive.flags:
        columns, units = [*columns, ("Time", stamps(drive, at, "all"))], [*units, "s"]
    below = ",".join(["C1"] * len(columns)) + "\n" + ",".join(units) + "\n"
    _rows(folder / "run.csv", columns, below=below)
    return str(folder / "run.csv")


def joined_csv(drive: Recorded, folder: Path, rng: Generator) -> str:
    """A DataFlash log as one table by a user's script: each column with its last value, FRD axes."""
    at = drive.rows(50.0, rng)
    held = (at // 100) * 100  # RCOU is logged at 10 Hz
    fix = (at // 200) * 200
    x = drive.x
    columns = [
        ("RCOU.C1", x["us"][held]), ("RCOU.C3", x["throttle"][held]), ("IMU.GyrX", x["p"][at]),
        ("IMU.GyrZ", -x["r"][at]), ("IMU.AccX", x["ax"][at]), ("IMU.AccY", -x["ay"][at]),
        ("IMU.AccZ", -x["az"][at]), ("ATT.Yaw", np.degrees(-x["psi"][at]) % 360.0),
        ("GPS.Spd", x["ground"][fix]),
    ]  # fmt: skip
    shown = _with_clock(drive, "TimeUS", 1e6 * (20 + stamps(drive, at, "all")), _shown(drive, columns))
    _rows(folder / "00000042.csv", shown)
    return str(folder / "00000042.csv")


def topics_csv(drive: Recorded, folder: Path, rng: Generator) -> str:
    """`rostopic echo -p`: one file a topic, with the time of arrival or of the export before the stamp."""

    def file(name: str, group: str, hz: float, columns: Callable[[Array], Columns], late: float) -> str:
        at = drive.rows(hz, rng)
        t = BEGAN + stamps(drive, at, group)
        arrived = np.ceil((t + 0.01) / BURST) * BURST
        if EXPORT_ONLY in drive.flags:  # written when the bag was exported, each topic by itself
            arrived = BEGAN + 1e6 + late + np.arange(at.size) / hz * 0.31
        lines = []
        values = _shown(drive, columns(at))
        table = np.stack([x for _, x in values], 1).tolist()
        for k, row in enumerate(table):
            cells = ",".join(f"{x:.6f}" if np.isfinite(x) else "" for x in row)
            lines.append(f"{round(1e9 * arrived[k])},{k},{round(1e9 * t[k])},base,{cells}")
        names = ",".join(f"field.{n}" for n, _ in values)
        head = f"%time,field.header.seq,field.header.stamp,field.header.frame_id,{names}"
        path = folder / f"{name}.csv"
        path.write_text(head + "\n" + "\n".join(lines) + "\n", encoding="utf-8")
        return str(path)

    x = drive.x

    def command(at: Array) -> Columns:
        return [
            ("steering_angle", x["command"][at]),
            ("steering_angle_velocity", 0 * x["r"][at]),
            ("speed", x["wheel"][at]),
        ]

    def imu(at: Array) -> Columns:
        zero = np.zeros(at.size)
        return [
            ("angular_velocity.x", x["p"][at]), ("angular_velocity.y", zero),
            ("angular_velocity.z", x["r"][at]),
            ("linear_acceleration.x", x["ax"][at]), ("linear_acceleration.y", x["ay"][at]),
            ("linear_acceleration.z", x["az"][at]),
        ]  # fmt: skip

    files = (file("drive", "steering", 50.0, command, 0.0), file("imu", "imu", 100.0, imu, EXPORT_LATE))
    return "+".join(files)


# ---- Logs of their own formats.


def ulog(drive: Recorded, folder: Path, rng: Generator) -> str:
    """PX4, by its specification, as the library only reads: docs.px4.io/main/en/dev_log/ulog_file_format."""

    def message(kind: bytes, content: bytes) -> bytes:
        return len(content).to_bytes(2, "little") + kind + content

    x = drive.x
    full = np.radians(FULL_DEG)
    topics: tuple[tuple[str, str, float, str, tuple[Array, ...]], ...] = (
        ("vehicle_angular_velocity", "float[3] xyz", 100.0, "imu", (x["p"], 0 * x["r"], -x["r"])),
        ("vehicle_acceleration", "float[3] xyz", 100.0, "imu", (x["ax"], -x["ay"], -x["az"])),
        ("actuator_servos", "float[1] control", 50.0, "steering", (-x["command"] / full,)),
        ("vehicle_local_position", "float x;float y;float vx;float vy;float heading", 20.0, "position",
         (x["x"], -x["y"], x["north"], -x["west"], -x["psi"])),
    )  # fmt: skip
    parts = [b"ULog\x01\x12\x35\x01" + (0).to_bytes(8, "little")]
    for name, fields, *_ in topics:
        parts.append(message(b"F", f"{name}:uint64_t timestamp;{fields};".encode()))
    for number, (name, *_) in enumerate(topics):
        parts.append(message(b"A", b"\x00" + number.to_bytes(2, "little") + name.encode()))
    for number, (_, _, hz, group, columns) in enumerate(topics):
        at = drive.rows(hz, rng)
        t = np.round((5 + stamps(drive, at, group)) * 1e6).astype(np.int64).tolist()
        table = np.stack([c[at] for c in columns], 1).astype(np.float32)
        head = number.to_bytes(2, "little")
        for stamp, row in zip(t, table, strict=True):
            parts.append(message(b"D", head + int(stamp).to_bytes(8, "little") + row.tobytes()))
    path = folder / "drive.ulg"
    path.write_bytes(b"".join(parts))
    return str(path)


ACKERMANN = "\n".join(
    f"float32 {name}"
    for name in ("steering_angle", "steering_angle_velocity", "speed", "acceleration", "jerk")
)


def ros_bag(drive: Recorded, folder: Path, rng: Generator) -> str:
    """An MCAP bag of ROS 2 with an IMU, odometry and Ackermann commands."""
    from rosbags import rosbag2
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store: Any = get_typestore(Stores.ROS2_HUMBLE)
    store.register(
        get_types_from_msg(ACKERMANN, "ackermann_msgs/msg/AckermannDrive")
        | get_types_from_msg(
            "std_msgs/Header header\nackermann_msgs/AckermannDrive drive",
            "ackermann_msgs/msg/AckermannDriveStamped",
        )
    )
    make: Any = {name.rpartition("/")[2]: kind for name, kind in store.types.items()}
    time = store.types["builtin_interfaces/msg/Time"]
    x = drive.x

    def header(t: float) -> Any:
        return make["Header"](stamp=time(sec=int(t), nanosec=int(t % 1 * 1e9)), frame_id="base")

    def vector(a: float = 0.0, b: float = 0.0, c: float = 0.0) -> Any:
        return make["Vector3"](x=float(a), y=float(b), z=float(c))

    def turned(k: int) -> Any:
        half = x["psi"][k] / 2
        return make["Quaternion"](x=0.0, y=0.0, z=float(np.sin(half)), w=float(np.cos(half)))

    nine, many = np.zeros(9), np.zeros(36)

    def imu(k: int, t: float) -> Any:
        turn, push = vector(x["p"][k], 0.0, x["r"][k]), vector(x["ax"][k], x["ay"][k], x["az"][k])
        return make["Imu"](header(t), turned(k), nine, turn, nine, push, nine)

    def odometry(k: int, t: float) -> Any:
        pose = make["Pose"](make["Point"](x=float(x["x"][k]), y=float(x["y"][k]), z=0.0), turned(k))
        twist = make["Twist"](vector(x["wheel"][k]), vector(c=x["r"][k]))
        posed, twisted = make["PoseWithCovariance"](pose, many), make["TwistWithCovariance"](twist, many)
        return make["Odometry"](header(t), "base", posed, twisted)

    def command(k: int, t: float) -> Any:
        angles = make["AckermannDrive"](float(x["command"][k]), 0.0, float(x["wheel"][k]), 0.0, 0.0)
        return make["AckermannDriveStamped"](header(t), angles)

    path = folder / "drive_mcap"
    writer: Any = rosbag2.Writer(path, version=8, storage_plugin=rosbag2.StoragePlugin.MCAP)
    messages = []
    topics = (
        ("/imu/data", "Imu", 100.0, "imu", imu),
        ("/odom", "Odometry", 40.0, "position", odometry),
        ("/drive", "AckermannDriveStamped", 50.0, "steering", command),
    )
    with writer:
        for topic, name, hz, group, build in topics:
            full = next(n for n in store.types if n.endswith(f"/{name}"))
            connection = writer.add_connection(topic, full, typestore=store)
            at = drive.rows(hz, rng)
            for k, late in zip(at.tolist(), (BEGAN + stamps(drive, at, group)).tolist(), strict=True):
                raw = store.serialize_cdr(build(k, late), full)
                messages.append((int((late + 0.004) * 1e9), connection, raw))
        for stamp, connection, raw in sorted(messages, key=lambda m: m[0]):
            writer.write(connection, stamp, raw)
    return str(path)


@dataclass(frozen=True)
class ForeignProfile:
    """write: returns the source as `identify` takes it. steering: "us", "command" or "angle"; per: how much
    of the recorded unit, in rad or us, one unit of the tool's answer is (`FULL_DEG` for a normalised one)."""

    write: Callable[[Recorded, Path, Generator], str]
    steering: str
    per: float = 1.0


FOREIGN: dict[str, ForeignProfile] = {
    "csv plain": ForeignProfile(plain_csv, "command"),
    "csv german": ForeignProfile(german_csv, "angle"),
    "csv motec": ForeignProfile(motec_csv, "angle"),
    "csv simulator": ForeignProfile(simulator_csv, "angle"),
    "csv joined": ForeignProfile(joined_csv, "us"),
    "csv rostopic": ForeignProfile(topics_csv, "command"),
    "ulog": ForeignProfile(ulog, "command", np.radians(FULL_DEG)),
    "ros": ForeignProfile(ros_bag, "command"),
}
