"""What goes wrong in the logs that people bring: 24 kinds, each with what a good answer says of it.

Half of the kinds are left out (`left_out`): do not tune the tool on them, as they show how it does on what
nobody thought of. Tuned on are those of public reports, which the issue on grades lists; left out are the
others. A fault acts on the drive before it is logged, on the file, or on how the rover is driven.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.random import Generator

from tests.engines.engine import Array
from tests.recordings.autopilot_logs import DROPPED
from tests.recordings.foreign_logs import EXPORT_ONLY, NO_CLOCK, REAR
from tests.recordings.signals import REPEATED, Recorded

AUTOPILOT = ("factory .BIN", "applet .BIN", "tlog 4 Hz", "tlog 10 Hz", "tlog 25 Hz", "tlog 50 Hz")
ONE_TABLE = ("csv plain", "csv german", "csv motec", "csv simulator")
TABLES = (*ONE_TABLE, "csv joined", "csv rostopic")
SEVERAL_STREAMS = ("csv rostopic", "ulog", "ros")
FOREIGN_NAMES = (*TABLES, "ulog", "ros")
EVERYWHERE = (*AUTOPILOT, *FOREIGN_NAMES)

LISTS = ("columns of ", "the columns are of ", "number ")  # begins of such lines

Changed = Callable[[Recorded, Generator], Recorded]


def _same(drive: Recorded, rng: Generator) -> Recorded:
    return drive


@dataclass(frozen=True)
class Fault:
    """named: what the answer says where it names the fault. driving: kinds of driving it happens in, () for
    all; engines: that it can be simulated with; of_rover: how the rover is driven, for `drawn`; of_file:
    what becomes of the bytes. halves: the log is cut into two files that are given together."""

    name: str
    profiles: tuple[str, ...]
    left_out: bool
    named: str
    of_drive: Changed = _same
    of_file: Callable[[bytes, Generator], bytes] | None = None
    driving: tuple[str, ...] = ()
    engines: tuple[str, ...] = ()
    of_rover: str = ""
    halves: bool = False

    def says(self, text: str) -> bool:
        """Whether a line of a text names the fault; lines that only list columns and numbers do not count."""
        lines = (line for line in text.splitlines() if not line.startswith(LISTS))
        return any(re.search(self.named, line, re.IGNORECASE) for line in lines)


# ---- Sensors.


def _speed_scale(drive: Recorded, rng: Generator) -> Recorded:
    """The estimator's speed is a multiple; GPS, where it is logged by itself, is right."""
    k = float(rng.choice([0.6, 1.3, 2.0, 4.0]))
    x = drive.x
    return drive.having(north=k * x["north"], west=k * x["west"], wheel=k * x["wheel"])


def _wheel_radius(drive: Recorded, rng: Generator) -> Recorded:
    """Speed from wheel encoders of which the radius is wrong by 15 to 40 %."""
    k = float(1 + rng.choice([-1, 1]) * rng.uniform(0.15, 0.4))
    x = drive.x
    return drive.having(north=k * x["north"], west=k * x["west"], wheel=k * x["wheel"])


def _compass_backwards(drive: Recorded, rng: Generator) -> Recorded:
    return drive.having(psi=drive.x["psi"] + np.pi)


def _upside_down(drive: Recorded, rng: Generator) -> Recorded:
    """The IMU's y and z point the other way; attitude and velocity are right."""
    x = drive.x
    return drive.having(r=-x["r"], ay=-x["ay"], az=-x["az"])


def _yaw_jump(drive: Recorded, rng: Generator) -> Recorded:
    psi = drive.x["psi"].copy()
    psi[round(rng.uniform(0.35, 0.65) * psi.size) :] += np.radians(rng.choice([-1, 1]) * rng.uniform(40, 110))
    return drive.having(psi=psi)


def _frozen(drive: Recorded, rng: Generator) -> Recorded:
    """One channel keeps its value for a third of the drive."""
    frozen = [("r",), ("north", "west", "wheel", "ground"), ("us", "command", "angle")]
    begin = rng.uniform(0.25, 0.55)
    found = {}
    for name in frozen[int(rng.integers(len(frozen)))]:
        x = drive.x[name].copy()
        a, b = round(begin * x.size), round((begin + 0.33) * x.size)
        x[a:b] = x[a]
        found[name] = x
    return drive.having(**found)


def _spikes(drive: Recorded, rng: Generator) -> Recorded:
    """Single samples of the gyro are far off, as of a loose wire."""
    r = drive.x["r"].copy()
    for k in rng.integers(0, r.size, r.size // 4000).tolist():
        r[k : k + 20] = rng.uniform(-30, 30)
    return drive.having(r=r)


def _blocks(size: int, rng: Generator, share: float = 0.01) -> Array:
    """(size,) true in a share of blocks as long as a sample."""
    bad = np.repeat(rng.uniform(size=size // 20 + 1) < share, 20)[:size]
    return np.asarray(bad)


def _nan(drive: Recorded, rng: Generator) -> Recorded:
    names = ("r", "wheel", "ground", "ay", "command", "angle", "north")
    bad = {name: _blocks(drive.x[name].size, rng) for name in names}
    return drive.having(**{name: np.where(at, np.nan, drive.x[name]) for name, at in bad.items()})


def _zeros(drive: Recorded, rng: Generator) -> Recorded:
    names = ("r", "wheel", "ground", "north", "west", "ay")
    bad = _blocks(drive.x["r"].size, rng)
    return drive.having(**{name: np.where(bad, 0.0, drive.x[name]) for name in names})


def _trim_slips(drive: Recorded, rng: Generator) -> Recorded:
    """A horn slips on the servo's shaft halfway: from then on another output drives straight."""
    begin = round(rng.uniform(0.35, 0.65) * drive.x["us"].size)
    late = np.arange(drive.x["us"].size) >= begin
    us = float(rng.choice([-1, 1]) * rng.uniform(40, 90))
    angle = us * float(np.ptp(drive.x["command"])) / max(float(np.ptp(drive.x["us"])), 1.0)
    x = drive.x
    return drive.having(
        us=x["us"] + us * late, command=x["command"] - angle * late, angle=x["angle"] - angle * late
    )


# ---- The recording.


def _flagged(*flags: str) -> Changed:
    def change(drive: Recorded, rng: Generator) -> Recorded:
        return replace(drive, flags=drive.flags | set(flags))

    return change


def _dropped(drive: Recorded, rng: Generator) -> Recorded:
    """Holes of .3 to 3 s, and single messages."""
    length, holes, at = drive.piloted.seconds, [], 20.0
    while (at := at + rng.exponential(12.0)) < length - 5:
        holes.append((at, at + rng.uniform(0.3, 3.0)))
    return replace(drive, holes=tuple(holes), lost=0.08, flags=drive.flags | {DROPPED})


def _clock_offset(drive: Recorded, rng: Generator) -> Recorded:
    """The IMU's stamps are of another clock."""
    return replace(drive, late={"imu": float(rng.choice([-1, 1]) * rng.uniform(0.1, 0.4))})


def _wrong_unit(drive: Recorded, rng: Generator) -> Recorded:
    """Values of another unit than the name or the unit's row says."""
    speed = {"speed": 3.6, "Geschwindigkeit [km/h]": 1 / 3.6, "Ground Speed": 1 / 3.6, "Car.vx": 3.6}
    turn = {
        "yaw_rate": 180 / np.pi,
        "Gierrate [deg/s]": np.pi / 180,
        "Gyro Yaw Velocity": np.pi / 180,
        "Car.YawRate": 180 / np.pi,
    }
    return replace(drive, units=speed if rng.uniform() < 0.5 else turn)


PAIRS = (
    ("yaw_rate", "roll_rate"),
    ("Gierrate [deg/s]", "Wankrate [deg/s]"),
    ("Gyro Yaw Velocity", "Gyro Roll Velocity"),
    ("Car.YawRate", "Car.RollRate"),
)


def _swapped(drive: Recorded, rng: Generator) -> Recorded:
    """Yaw rate and roll rate bear each other's names."""
    return replace(drive, names={a: b for pair in PAIRS for a, b in (pair, pair[::-1])})


def _two_rovers(drive: Recorded, rng: Generator) -> Recorded:
    """From halfway on, a rover whose linkage turns the wheels by 1.4 times as much."""
    x, k = drive.x, 1 / 1.4
    late = np.arange(x["us"].size) >= x["us"].size // 2
    us = np.where(late, np.round(1500 + k * (x["us"] - 1500)), x["us"])
    return drive.having(
        us=us, command=np.where(late, k, 1.0) * x["command"], angle=np.where(late, k, 1.0) * x["angle"]
    )


def _burnt(content: bytes, rng: Generator) -> bytes:
    """1 to 2 % of the bytes are garbage or zeros, in blocks of 4 KiB as of an SD card; none of the head."""
    data, block = bytearray(content), 4096
    count = max(1, round(rng.uniform(0.01, 0.02) * len(data) / block))
    for _ in range(count):
        at = int(rng.integers(4 * block, max(len(data) - block, 4 * block + 1)))
        filled = bytes(block) if rng.uniform() < 0.5 else rng.bytes(block)
        data[at : at + block] = filled[: max(len(data) - at, 0)]
    return bytes(data)


FAULTS: tuple[Fault, ...] = (
    # tuned on: of public reports
    Fault(
        "speed scale",
        EVERYWHERE,
        False,
        r"speed.*(\btimes\b|factor|scale|disagree|contradict|GPS)",
        _speed_scale,
    ),
    Fault(
        "wheel radius",
        EVERYWHERE,
        False,
        r"speed.*(\btimes\b|factor|scale|disagree|contradict|GPS)|wheel radius",
        _wheel_radius,
    ),
    Fault(
        "compass backwards",
        AUTOPILOT,
        False,
        r"compass|heading.*(180|backward|opposite|against)",
        _compass_backwards,
    ),
    Fault(
        "gyro upside down",
        AUTOPILOT,
        False,
        r"upside|AHRS_ORIENTATION|(gyro|yaw rate).*(sign|opposite|invert|against)",
        _upside_down,
    ),
    Fault(
        "yaw jump", AUTOPILOT, False, r"(yaw|heading|compass).*(jump|step|change|turned by|part)", _yaw_jump
    ),
    Fault(
        "missing clock",
        (*ONE_TABLE, "csv joined"),
        False,
        r"--rate|no (clock|time)|(clock|time).*(missing|guess|not found)|not found.*time",
        _flagged(NO_CLOCK),
    ),
    Fault("rear wheel", ("csv simulator",), False, r"rear|Sensor\.SAngle", _flagged(REAR)),
    Fault(
        "reversed servo", AUTOPILOT, False, r"revers", driving=("by hand", "stop and go"), of_rover="reversed"
    ),
    Fault("damage", AUTOPILOT, False, r"damage|lost|skipped|garbage", of_file=_burnt),
    Fault("NaN", FOREIGN_NAMES, False, r"nan|empty|missing|not finite|impossible", _nan),
    Fault("export stamps", ("csv rostopic",), False, r"header\.stamp|export|arrival", _flagged(EXPORT_ONLY)),
    Fault("gyro spikes", EVERYWHERE, False, r"spike|impossible|outlier|implausible|far off", _spikes),
    # left out: do not tune on these
    Fault(
        "frozen channel", EVERYWHERE, True, r"(stay|froz|constant|one value|same value|dead|stuck)", _frozen
    ),
    Fault("wrong unit", ONE_TABLE, True, r"unit|km/h|deg/s|rad/s", _wrong_unit),
    Fault("zeros", EVERYWHERE, True, r"zero|\b0\b.*(sample|value)|impossible|dropout", _zeros),
    Fault(
        "dropped messages",
        EVERYWHERE,
        True,
        r"gap|hole|drop|missing|lost|could not write|interrupt",
        _dropped,
    ),
    Fault(
        "clock offset",
        SEVERAL_STREAMS,
        True,
        r"offset|(clock|stamp).*(differ|late|apart|another|shift)",
        _clock_offset,
    ),
    Fault(
        "constant steering",
        EVERYWHERE,
        True,
        r"steering stayed|constant|one value|too little|hardly|does not follow",
        driving=("by hand",),
        of_rover="constant",
    ),
    Fault(
        "two rovers",
        ("factory .BIN", "csv plain", "csv german"),
        True,
        r"do not agree|two rovers|several rovers|contradict|chang",
        _two_rovers,
        halves=True,
    ),
    Fault(
        "saturated steering",
        EVERYWHERE,
        True,
        r"satur|end stop|limit",
        driving=("by hand",),
        of_rover="saturated",
    ),
    Fault(
        "reverse",
        AUTOPILOT,
        True,
        r"revers|backward",
        driving=("by hand",),
        engines=("foreign",),
        of_rover="reverse",
    ),
    Fault(
        "swapped columns",
        ONE_TABLE,
        True,
        r"swap|roll_rate|roll rate|Wankrate|RollRate|Roll Velocity|certain|guess",
        _swapped,
    ),
    Fault("trim slips", EVERYWHERE, True, r"trim|straight|halves|contradict|chang", _trim_slips),
    Fault("repeated rows", EVERYWHERE, True, r"repeat|duplicate|time of another", _flagged(REPEATED)),
)
BY_NAME: Mapping[str, Fault] = {fault.name: fault for fault in FAULTS}
