"""A season of logs of simulated vehicles, some with a drift hidden in them.

Every vehicle is the simulated rover of `sitl` with other numbers. It repeats one recorded sweep on every
session, each time at a slightly other speed and on a slightly other ground. Its logs have the board's id, the
date (GPS) and the parameters as the firmware writes them. The truth is returned, never written.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, date, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from rover_sweep.logs.read import read_logs
from rover_sweep.logs.readers.screening import screened
from rover_sweep.redrive.recorded_course import course_of
from sitl.flash_log.dataflash_writer import HEAD, encoded
from sitl.flash_log.formats import FORMATS
from sitl.plant.variant import PlantParameters, load_variant
from sitl.redrive.course import Course
from sitl.redrive.open_loop import redrive
from tests.comparison.pairs import varied, vehicle_file

RECORDED = Path(__file__).parents[1] / "data" / "concealed-ardurover" / "c" / "run2.BIN"
BEGIN = date(2026, 3, 2)
GPS_EPOCH = datetime(1980, 1, 6, tzinfo=UTC)
PLAY = 0.002  # rad, half the gap of every linkage


@dataclass(frozen=True)
class Hidden:
    """A drift. quantity: as the tool should name it; gradual: it grows from `session` on, else it jumps."""

    kind: str
    quantity: str
    gradual: bool
    session: int


KINDS: Mapping[str, tuple[str, bool]] = {
    "tyre wear": ("C", True),
    "slow servo": ("servo_lag", True),
    "growing play": ("steering_backlash", True),
    "bent linkage": ("steering_trim", False),
    "board swapped": ("board", False),
    "filter by hand": ("INS_GYRO_FILTER", False),
}


@dataclass(frozen=True)
class DrawnVehicle:
    """A vehicle of the fleet: its numbers, the dates of its sessions, and what is hidden in it."""

    name: str
    rover: PlantParameters
    days: tuple[date, ...]
    hidden: Hidden | None

    def board(self, session: int) -> str:
        """The id that the firmware writes into the log of a session."""
        h = self.hidden
        swapped = h is not None and h.kind == "board swapped" and session >= h.session
        number = int(self.name.rpartition("-")[2]) * 7919 + (4099 if swapped else 0)
        return f"CubeOrange 0028001F 3432510D {number:08X}"


def drawn_fleet(
    vehicles: int, sessions: int, kinds: Sequence[str], seed: int = 1
) -> tuple[DrawnVehicle, ...]:
    """A fleet whose first vehicles, in a drawn order, have the hidden kinds."""
    random = np.random.default_rng(seed)
    chosen = dict(zip(random.permutation(vehicles).tolist(), kinds, strict=False))
    out = []
    for v in range(vehicles):
        own = np.random.default_rng([seed, v])
        steps = own.integers(10, 19, sessions)
        days = tuple(BEGIN + timedelta(days=int(n)) for n in np.cumsum(steps))
        hidden = None
        if v in chosen:
            quantity, gradual = KINDS[chosen[v]]
            session = (
                0 if chosen[v] == "tyre wear" else int(own.integers(sessions // 3, sessions // 3 * 2 + 1))
            )
            hidden = Hidden(chosen[v], quantity, gradual, session)
        out.append(DrawnVehicle(f"rover-{v + 1:02d}", _numbers(own), days, hidden))
    return tuple(out)


def _numbers(random: np.random.Generator) -> PlantParameters:
    return replace(varied(load_variant("nominal"), random), effects={"steering_backlash": {"b": PLAY}})


def write_season(fleet: Sequence[DrawnVehicle], logs: Path, files: Path, seed: int = 1) -> list[Path]:
    """Drive every session: logs/<vehicle>/00000001.BIN and files/<vehicle>.toml; logs that exist are kept."""
    course = course_of(screened(read_logs(str(RECORDED))[0]))
    files.mkdir(parents=True, exist_ok=True)
    out = []
    for v, vehicle in enumerate(fleet):
        folder = logs / vehicle.name
        folder.mkdir(parents=True, exist_ok=True)
        text = vehicle_file(vehicle.rover, np.random.default_rng([seed, v, 99]))
        (files / f"{vehicle.name}.toml").write_text(text, encoding="utf-8")
        for k, day in enumerate(vehicle.days):
            target = folder / f"{k + 1:08d}.BIN"
            if not target.is_file():
                _drive(vehicle, k, day, course, target, np.random.default_rng([seed, v, k]))
            out.append(target)
    return out


def _drive(
    vehicle: DrawnVehicle, k: int, day: date, course: Course, target: Path, random: np.random.Generator
) -> None:
    rover, parameters = _changed(vehicle, k, course.parameters)
    ground = 1.0 + 0.02 * random.standard_normal()
    rover = replace(
        rover,
        friction=rover.friction * (1.0 + 0.03 * random.standard_normal()),
        front_cornering_stiffness=rover.front_cornering_stiffness * ground,
        rear_cornering_stiffness=rover.rear_cornering_stiffness * ground,
        steering_trim_us=rover.steering_trim_us + random.standard_normal(),
        servo_lag=rover.servo_lag + 0.001 * random.standard_normal(),
    )
    mark = (float(course.t[0]) + 0.5, vehicle.board(k))
    again = replace(
        course,
        speed=course.speed * (1.0 + 0.03 * random.standard_normal()),
        marks=tuple(sorted((*course.marks, mark))),
        parameters=parameters,
    )
    part = target.with_suffix(".part")
    redrive(again, rover, part, int(random.integers(1, 2**31)))
    with part.open("ab") as file:
        file.write(gps_message(float(course.t[-1]), day))
    part.replace(target)


def _changed(
    vehicle: DrawnVehicle, k: int, parameters: Mapping[str, float]
) -> tuple[PlantParameters, dict[str, float]]:
    """The rover and its parameters on a session, with what is hidden in it."""
    rover, hidden, found = vehicle.rover, vehicle.hidden, dict(parameters)
    if hidden is None or k < hidden.session:
        return rover, found
    first, last = vehicle.days[hidden.session], vehicle.days[-1]
    grown = (vehicle.days[k] - first) / (last - first) if last > first else 1.0
    more: dict[str, Any] = {}
    match hidden.kind:
        case "tyre wear":
            worn = 1.0 - 0.25 * grown
            more = {
                "front_cornering_stiffness": rover.front_cornering_stiffness * worn,
                "rear_cornering_stiffness": rover.rear_cornering_stiffness * worn,
            }
        case "slow servo":
            more = {"servo_lag": rover.servo_lag + 0.030 * grown}
        case "growing play":
            more = {"effects": {"steering_backlash": {"b": PLAY + 0.012 * grown}}}
        case "bent linkage":
            more = {"steering_trim_us": rover.steering_trim_us + 18.0}
        case "board swapped":
            x, y, z = rover.imu_position
            more = {"imu_position": (x + 0.005, y, z), "gyro_bias": (0.002, 0.001, -0.001)}
        case "filter by hand":
            found["INS_GYRO_FILTER"] = 10.0
    return replace(rover, **more), found


def gps_message(t: float, day: date) -> bytes:
    """A GPS message with the date at noon."""
    since = datetime(day.year, day.month, day.day, 12, tzinfo=UTC) - GPS_EPOCH
    week, rest = divmod(since, timedelta(weeks=1))
    fmt = FORMATS["GPS"]
    values: tuple[Any, ...] = (round(t * 1e6), 0, 3, round(rest.total_seconds() * 1000), week, 12, 0.8)
    values += (-35.36, 149.16, 584.0, 0.0, 0.0, 0.0, 0.0, 0)
    packed = fmt.packer.pack(*(encoded(c, v) for c, v in zip(fmt.codes, values, strict=True)))
    return HEAD + bytes([fmt.type]) + packed


def spoil(paths: Sequence[Path], seed: int = 1) -> dict[Path, str]:
    """Damage the first three logs, make the others those of a copter and of a boat; {path: what it is}."""
    random = np.random.default_rng(seed)
    out = {}
    for path, what in zip(paths, ("empty", "no log", "damaged", "copter", "boat"), strict=False):
        data = bytearray(path.read_bytes())
        match what:
            case "empty":
                data = bytearray()
            case "no log":
                data = bytearray(random.integers(0, 256, 200_000, dtype=np.uint8).tobytes())
            case "damaged":
                for at in random.integers(0, len(data) - 400, 60).tolist():
                    data[at : at + 400] = random.integers(0, 256, 400, dtype=np.uint8).tobytes()
            case "copter":
                data = data.replace(b"ArduRover V4.6.3 (embedded)", b"ArduCopter V4.6.3 (embedd.)")
            case "boat":
                data = _as_boat(data)
        path.write_bytes(bytes(data))
        out[path] = what
    return out


def _as_boat(data: bytearray) -> bytearray:
    """FRAME_CLASS 2 in place of the rover's."""
    fmt = FORMATS["PARM"]
    codes = zip(fmt.codes[1:], ("FRAME_CLASS", 2.0, 1.0), strict=True)
    row = fmt.packer.pack(0, *(encoded(c, v) for c, v in codes))
    name = row[8:24]
    at = data.index(name) - 8
    data[at + 8 : at + len(row)] = row[8:]
    return data
