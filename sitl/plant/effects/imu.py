"""A tilted IMU, its scale errors, and an undocumented low-pass in it."""

from __future__ import annotations

from collections import deque
from math import cos, exp, inf, pi, sin

from sitl.plant.effects_table import Effects, number

Vector = tuple[float, float, float]

IDS = frozenset({"imu_tilt"})


class Mounting:
    """Turns vectors of the body, FRD, into those of an IMU whose mounting angles are ISO: yaw (left), pitch
    (nose down), roll (left side up), in this order."""

    __slots__ = ("_rows", "angles")

    def __init__(self, effects: Effects) -> None:
        roll, pitch, yaw = (number(effects, "imu_tilt", name) for name in ("roll", "pitch", "yaw"))
        self.angles = (roll, -pitch, -yaw)
        # the same rotations about FRD axes: roll about x as it is, pitch and yaw with their axes turned round
        self._rows = _rows(*self.angles)

    def seen(self, vector: Vector) -> Vector:
        """A body vector in the IMU's axes."""
        x, y, z = vector
        a, b, c = self._rows
        return (
            a[0] * x + a[1] * y + a[2] * z,
            b[0] * x + b[1] * y + b[2] * z,
            c[0] * x + c[1] * y + c[2] * z,
        )


class FirstOrder:
    """The lag 1/(2 pi f) of a signal that is held between samples; the first sample sets it."""

    __slots__ = ("_share", "_value")

    def __init__(self, sample_hz: float, cutoff_hz: float) -> None:
        self._share = 1.0 - exp(-2.0 * pi * cutoff_hz / sample_hz)
        self._value: float | None = None

    def apply(self, sample: float) -> float:
        """The next filtered value."""
        old = sample if self._value is None else self._value
        self._value = value = old + self._share * (sample - old)
        return value


class Delayed:
    """The signal as it was 1/(2 pi f) ago, linear between samples."""

    __slots__ = ("_part", "_past")

    def __init__(self, sample_hz: float, cutoff_hz: float) -> None:
        late = sample_hz / (2.0 * pi * cutoff_hz)
        whole = int(late)
        self._part = late - whole
        self._past: deque[float] = deque(maxlen=whole + 2)

    def apply(self, sample: float) -> float:
        """The next delayed value."""
        past = self._past
        if not past:
            past.extend([sample] * (past.maxlen or 0))
        past.append(sample)
        return past[1] + self._part * (past[0] - past[1])


def scales(effects: Effects) -> tuple[float, float]:
    """(gyro, accelerometer): measured over true."""
    return 1.0 + number(effects, "sensor_scale", "gyro"), 1.0 + number(effects, "sensor_scale", "accel")


def hidden_cutoffs(effects: Effects) -> tuple[float, float]:
    """(gyro, accelerometer) cut-offs [Hz] of unknown filters; infinite without one."""
    return (
        number(effects, "sensor_filter", "gyro_hz", inf),
        number(effects, "sensor_filter", "accel_hz", inf),
    )


def _rows(roll: float, pitch: float, yaw: float) -> tuple[Vector, Vector, Vector]:
    """Rows of the matrix from the outer into the turned axes: yaw, then pitch, then roll."""
    cr, sr, cp, sp, cy, sy = cos(roll), sin(roll), cos(pitch), sin(pitch), cos(yaw), sin(yaw)
    return (
        (cp * cy, cp * sy, -sp),
        (sr * sp * cy - cr * sy, sr * sp * sy + cr * cy, sr * cp),
        (cr * sp * cy + sr * sy, cr * sp * sy - sr * cy, cr * cp),
    )
