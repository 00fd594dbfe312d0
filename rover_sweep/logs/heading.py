"""Headings that jump, or point aside of the way that the rover moves.

A rover with steered wheels moves along its heading, ahead or in reverse, so the angle between velocity and
heading is 0 or 180 degrees but for sideslip. Where a heading changes at once by what the gyro does not show,
it is the heading that jumped.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rover_sweep.data.recording import Array, Complex, Signal
from rover_sweep.logs.log import Log

GRID = 0.1  # s
AT_ONCE, AROUND = 3, 25  # steps of the grid: a jump takes less; medians before and after it
JUMP = np.radians(20.0)  # smallest jump; a gyro's drift in `AROUND` is a few degrees
SHARE = 0.7  # of the change between the medians, which the jump itself must be
MOVING = 0.5  # m/s, from which a velocity has a direction
ASIDE = np.radians(15.0)  # between velocity and heading; sideslip of a car that does not skid is less
ALONG = 0.7  # length of the mean direction along an axis, from which the velocity has one
LEAST = 5.0  # s of driving, from which its direction is judged


@dataclass(frozen=True, eq=False)
class HeadingError:
    """By how much a heading is wrong: `angle` (parts,) rad in the parts that begin at `since` (parts,) s.

    jumps: (time [s], change [rad]) of each. Whether the rover drove ahead or in reverse is not known here.
    """

    since: Array
    angle: Array
    jumps: tuple[tuple[float, float], ...]

    def at(self, t: Array) -> Array:
        """The error (n,) rad at times (n,) s."""
        return np.asarray(self.angle[np.clip(np.searchsorted(self.since, t, "right") - 1, 0, None)])

    @property
    def aside(self) -> float:
        """The largest error, rad."""
        return float(self.angle[int(np.argmax(np.abs(self.angle)))])


def heading_error(log: Log) -> HeadingError | None:
    """The error of the heading that turned the velocity into `speed` and `vy`; None where there is none."""
    if not {"psi", "r", "vy", "speed"} <= set(log.signals):
        return None
    psi, r, speed = (log.signals[name] for name in ("psi", "r", "speed"))
    if min(psi.t.size, r.t.size, speed.t.size) < 3:
        return None
    t = np.arange(max(s.t[0] for s in (psi, r, speed)), min(s.t[-1] for s in (psi, r, speed)), GRID)
    if t.size < 2 * AROUND:
        return None
    velocity = speed.on(t) + 1j * log.signals["vy"].on(t)
    jumps = _jumps(t, psi.on(t), r)
    turned = np.zeros(t.size)
    for at, change in jumps:
        turned[t >= at] += change
    # without the jumps the velocity has one axis, if it was the heading that jumped
    steady = velocity * np.exp(1j * turned)
    if jumps and _axis(steady)[1] < max(ALONG, _axis(velocity)[1]):
        return None
    if _axis(steady)[1] < ALONG:
        return None
    since = np.array([t[0], *(at for at, _ in jumps)])
    change = np.concatenate(([0.0], np.cumsum([change for _, change in jumps])))
    # velocity in the body's axes is turned by minus the error of the heading
    angle = change - _axis(steady)[0]
    angle = np.array([_refined(velocity, t, since, k, float(a)) for k, a in enumerate(angle)])
    if np.max(np.abs(angle)) < ASIDE:
        return None
    return HeadingError(since, angle, jumps)


def _jumps(t: Array, psi: Array, r: Signal) -> tuple[tuple[float, float], ...]:
    """(time [s], change [rad]) where the heading psi (n,) changes at once by what the gyro does not show."""
    turned = np.concatenate(([0.0], np.cumsum(np.diff(r.t) * 0.5 * (r.x[1:] + r.x[:-1]))))
    away = np.unwrap(psi - np.interp(t, r.t, turned))
    found: list[tuple[float, float]] = []
    at_once = np.abs(away[AT_ONCE:] - away[:-AT_ONCE])
    k = 0
    while k < at_once.size:
        if at_once[k] < JUMP:
            k += 1
            continue
        end = k
        while end + 1 < at_once.size and at_once[end + 1] >= JUMP:
            end += 1
        middle = (k + end + AT_ONCE) // 2
        before, after = away[max(0, k - AROUND) : k + 1], away[end + AT_ONCE : end + AT_ONCE + AROUND]
        change = float(np.median(after) - np.median(before))
        sudden = float(away[end + AT_ONCE] - away[k]) if end + AT_ONCE < away.size else 0.0
        quick = end - k <= 2 * AT_ONCE
        change = (change + np.pi) % (2 * np.pi) - np.pi
        if quick and abs(change) > JUMP and abs(sudden - change) < (1 - SHARE) * abs(change) + 0.1:
            found.append((float(t[middle]), change))
        k = end + AT_ONCE
    return tuple(found)


def _axis(velocity: Complex) -> tuple[float, float]:
    """(direction in -90 to 90 degrees [rad], length 0..1) of the mean axis of velocities (n,)."""
    fast = np.abs(velocity) > MOVING
    if fast.sum() * GRID < LEAST:
        return 0.0, 0.0
    v = velocity[fast]
    mean = np.sum(v**2 / np.abs(v)) / np.sum(np.abs(v))
    return 0.5 * float(np.angle(mean)), float(abs(mean))


def _refined(velocity: Complex, t: Array, since: Array, part: int, angle: float) -> float:
    """The error of one part, from its own driving where that is enough."""
    end = since[part + 1] if part + 1 < since.size else np.inf
    rest, length = _axis((velocity * np.exp(1j * angle))[(t >= since[part]) & (t < end)])
    return angle - rest if length > ALONG else angle
