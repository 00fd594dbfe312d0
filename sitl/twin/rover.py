"""The rover for other programs: steps by PWM or by speed, and recorded drives."""

from __future__ import annotations

import csv
import sys
from collections.abc import Sequence
from dataclasses import replace
from math import ceil, isfinite
from pathlib import Path
from typing import Any, NamedTuple

from sitl.plant.plant import Plant
from sitl.plant.variant import PlantParameters
from sitl.redrive.open_loop import FASTEST_YAW, LARGEST_ROLL, PHYSICS_S
from sitl.redrive.speed import STANDING, SpeedFollower
from sitl.twin.numbers import PARAMETERS

LOOP_S = 0.02  # longest time between two corrections of the speed
LONGEST_GAP = 10.0  # s, between two rows of a recorded drive
COLUMNS = ("time", "steering", "speed")


class Motion(NamedTuple):
    """How the rover moves. SI units, ISO axes: x forward, y left, z up; a left turn is positive.

    t [s]. x (north), y (west) [m], V_x, V_y (along and across the heading) [m/s]: of the reference point, on
    the roll axis below the CG. psi heading [rad], 0 is north, unwrapped; r yaw rate, p roll rate [rad/s]; phi
    roll [rad]; delta road-wheel angle [rad]. a_y [m/s2]: specific force to the left at the IMU, in the axes
    of the rolled body, as an accelerometer without errors measures it.
    """

    t: float
    x: float
    y: float
    psi: float
    V_x: float
    V_y: float
    r: float
    phi: float
    p: float
    a_y: float
    delta: float


class Rover:
    """The rover, at rest. `step` it with PWM, or `follow` a speed; `drive` repeats a recorded drive.

    seed: of the random unevenness of the road; None for an even road.
    """

    def __init__(self, seed: int | None = None, parameters: PlantParameters = PARAMETERS) -> None:
        even = replace(parameters, road_force=0.0, road_yaw_moment=0.0, road_roll_moment=0.0)
        self._parameters, self._seed = (even if seed is None else parameters), seed or 0
        self.begin()

    def begin(self, t: float = 0.0, psi: float = 0.0, speed: float = 0.0) -> Motion:
        """Start again at t [s] and the origin, straight ahead with a heading [rad] and a speed [m/s]."""
        self._plant = Plant(self._parameters, self._seed)
        self._follower = SpeedFollower(self._parameters, LOOP_S)
        state = self._plant.state
        state.t, state.psi, state.vx = t, psi, speed
        return self.motion

    @property
    def motion(self) -> Motion:
        """The present motion."""
        s = self._plant.state
        return Motion(s.t, s.x, s.y, s.psi, s.vx, s.vy, s.r, s.phi, s.p, s.ay, s.delta)

    def step(self, steering_us: float, throttle_us: float, dt: float) -> Motion:
        """The motion after dt [s] with these PWM [us] held; 0 us means no pulse.

        ValueError for numbers that are not finite, and where the rover overturns.
        """
        if not (dt > 0.0 and isfinite(dt + steering_us + throttle_us)):
            raise ValueError(
                f"a step of {dt} s with {steering_us} us and {throttle_us} us is impossible; give finite "
                "numbers and a time greater than 0"
            )
        pieces = max(ceil(dt / PHYSICS_S - 1e-6), 1)
        for _ in range(pieces):
            self._plant.step(steering_us, throttle_us, dt / pieces)
        self._refuse_overturned()
        return self.motion

    def follow(self, steering_us: float, speed: float, dt: float, rate: float = 0.0) -> Motion:
        """As `step`, with the throttle that keeps a speed [m/s]. rate [m/s2]: its rate of change."""
        pieces = max(ceil(dt / LOOP_S - 1e-6), 1)
        self._follower.period = dt / pieces
        for k in range(pieces):
            wanted = speed + rate * k * self._follower.period
            throttle = self._follower.throttle(wanted, rate, self._plant.state.vx)
            self.step(steering_us, throttle, self._follower.period)
        return self.motion

    def drive(
        self, t: Sequence[float], steering_us: Sequence[float], speed: Sequence[float], psi: float = 0.0
    ) -> dict[str, Any]:
        """Repeat a drive: times t (n,) [s], steering PWM (n,) [us], held from each time on, speed (n,) [m/s].

        Starts again with the first speed and the heading psi [rad]. Returns arrays (n,) at the times, with
        the names of `Motion`. Needs numpy. ValueError for unusable arrays, and where the rover overturns.
        """
        import numpy as np

        t, steering, speed = _drive_arrays(t, steering_us, speed)
        counts = np.maximum(np.ceil(np.diff(t) / LOOP_S - 1e-6), 1).astype(int)
        spans = zip(t[:-1], t[1:], counts, strict=True)
        loops = np.concatenate([*(np.linspace(a, b, n, endpoint=False) for a, b, n in spans), t[-1:]])
        wanted = np.interp(loops, t, speed)
        rates = np.gradient(wanted, loops)
        first = float(speed[0])
        motions = [self.begin(float(t[0]), psi, first if first >= STANDING else 0.0)]
        inputs = np.column_stack((np.repeat(steering[:-1], counts), wanted[:-1], np.diff(loops), rates[:-1]))
        motions += [self.follow(*row) for row in inputs.tolist()]
        at = np.concatenate(([0], np.cumsum(counts)))
        table = np.array(motions)[at]
        return dict(zip(Motion._fields, (t, *table[:, 1:].T), strict=True))

    def _refuse_overturned(self) -> None:
        s = self._plant.state
        if not (abs(s.phi) < LARGEST_ROLL and abs(s.r) < FASTEST_YAW):
            raise ValueError(
                f"the simulated rover overturns or spins at {s.t:.1f} s (roll {s.phi:.3g} rad, yaw rate "
                f"{s.r:.3g} rad/s); steer less or drive more slowly"
            )


def _drive_arrays(*columns: Sequence[float]) -> list[Any]:
    """Time, steering and speed as arrays (n,); ValueError where they cannot be driven."""
    import numpy as np

    arrays = [np.asarray(column, dtype=float) for column in columns]
    t = arrays[0]
    if t.ndim != 1 or t.size < 2 or any(a.shape != t.shape for a in arrays):
        raise ValueError(f"time, steering and speed must be of one length, 2 or more, not {t.size}")
    if not all(np.isfinite(a).all() for a in arrays):
        raise ValueError("time, steering or speed has values that are not numbers; remove these rows")
    gaps = np.diff(t)
    if not (gaps > 0.0).all():
        raise ValueError(f"time must ascend; it does not after {t[np.argmin(gaps)]:g} s")
    if gaps.max() > LONGEST_GAP:
        raise ValueError(f"time has a gap of {gaps.max():g} s; give seconds, and at most {LONGEST_GAP:g} s")
    return arrays


def read_drive(path: Path) -> list[list[float]]:
    """Columns time [s], steering [us], speed [m/s] of a csv file with a header; ValueError without them."""
    with path.open(newline="", encoding="utf-8-sig") as file:
        rows = csv.DictReader(file)
        missing = [name for name in COLUMNS if name not in (rows.fieldnames or ())]
        if missing:
            raise ValueError(f"lacks the columns {', '.join(missing)}; it needs {', '.join(COLUMNS)}")
        try:
            table = [[float(row[name]) for name in COLUMNS] for row in rows]
        except (TypeError, ValueError):
            raise ValueError(f"line {rows.line_num} has something that is not a number") from None
    return [list(column) for column in zip(*table, strict=True)] or [[], [], []]


def write_motion(path: Path, motion: dict[str, Any]) -> None:
    """A csv file of what `Rover.drive` returns."""
    with path.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file)
        rows.writerow(motion)
        rows.writerows(zip(*(column.tolist() for column in motion.values()), strict=True))


def main(words: Sequence[str]) -> int:
    """`DRIVE.csv [MOTION.csv]`: the motion of a recorded drive as a csv file; returns the exit code."""
    if len(words) not in (1, 2):
        print("give DRIVE.csv with columns time, steering, speed, and MOTION.csv to write", file=sys.stderr)
        return 2
    source = Path(words[0])
    target = Path(words[1]) if len(words) == 2 else source.with_name(f"{source.stem}_motion.csv")
    try:
        t, steering, speed = read_drive(source)
        write_motion(target, Rover().drive(t, steering, speed))
    except (OSError, ValueError) as error:
        print(f"{source}: {error}", file=sys.stderr)
        return 2
    print(target)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
