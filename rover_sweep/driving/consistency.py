"""Hidden faults of recordings from other systems: runs with another clock, sloping ground."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.ndimage import uniform_filter1d

from rover_sweep.data.geometry import STANDARD_GRAVITY
from rover_sweep.data.recording import Array, Note
from rover_sweep.driving.stretches import RATE, DrivenPart, usable_driving
from rover_sweep.logs.log import Log

SHIFTS = np.arange(-1.5, 2.0, 0.02)  # s, between steering and yaw rate
OTHER_CLOCK = 0.3  # s from the usual delay of the runs, from which one has a clock of its own
BETTER = 0.7  # of the unexplained variance, which that delay must leave at most
FOLLOWS, UNRELATED = 0.8, 0.4  # share of the yaw rate that the steering gives in good runs, and in bad ones
SHARED = 0.5  # share of a_y minus V r that the heading must give, and 2 degrees, for ground that slopes
SLOPE = np.sin(np.radians(2.0))


def with_one_clock(logs: Sequence[Log]) -> tuple[Log, ...]:
    """The logs, each steering shifted to the delay of most of them, with notes.

    A log whose steering has another clock is shifted. One in which the yaw rate follows the steering
    at none of the delays is left out. Fewer than three logs do not show which of them is wrong.
    """
    found = [_delays(usable_driving([log]).stretches) for log in logs]
    best = np.array([float(shares.max()) for shares in found])
    if np.sum(best > FOLLOWS) < 3:
        return tuple(logs)
    at = np.array([int(np.argmax(shares)) for shares in found])
    usual = int(np.median(at[best > FOLLOWS]))
    out, lost = [], []
    for log, shares, k, share in zip(logs, found, at, best, strict=True):
        late = float(SHIFTS[k] - SHIFTS[usual])
        if 0 < share < UNRELATED:
            words = "unlike in the other runs, the yaw rate does not follow the steering at any delay"
            lost.append(Note("warning", f"{log.name} was left out: {words}"))
            continue
        if abs(late) > OTHER_CLOCK and 1 - share < BETTER * (1 - shares[usual]) and share > UNRELATED:
            s = log.steering[0]
            words = (
                f"its steering is {abs(late):.2g} s {'early' if late > 0 else 'late'} against the other runs"
            )
            note = Note("warning", f"{log.name}: {words}, and was shifted by that: has it another clock?")
            log = replace(log, steering=(replace(s, t=s.t + late),), notes=(*log.notes, note))
        out.append(log)
    out[0] = replace(out[0], notes=(*out[0].notes, *lost))
    return tuple(out)


def _delays(parts: Sequence[DrivenPart]) -> Array:
    """Share of the yaw rate that V u(t - delay), V and a constant give at `SHIFTS`; 0 without driving."""
    shares = np.zeros(SHIFTS.size)
    if not parts:
        return shares
    v, r = (np.concatenate([getattr(s, name) for s in parts]) for name in "vr")
    base = np.linalg.qr(np.stack((v, np.ones(v.size)), 1))[0]
    y = r - base @ (base.T @ r)
    for k, shift in enumerate(SHIFTS):
        x = v * np.concatenate([s.steered(float(shift)) for s in parts])
        x -= base @ (base.T @ x)
        shares[k] = float(y @ x) ** 2 / max(float(x @ x) * float(y @ y), 1e-300)
    return shares


def with_slope(log: Log) -> Log:
    """The log, with a note if a_y changes with the heading, as on ground that slopes or banks."""
    parts = usable_driving([log]).stretches if "ay" in log.signals else ()
    if not parts:
        return log
    rows, rest = [], []
    for s in sorted(parts, key=lambda s: -s.seconds):
        psi = log.signals["psi"].on(s.t) if "psi" in log.signals else np.cumsum(s.r) / RATE
        rows.append(np.stack((s.v * s.r, np.ones(s.t.size), np.cos(psi), np.sin(psi)), 1))
        rest.append(log.signals["ay"].on(s.t))
        if "psi" not in log.signals:  # each part has a heading of its own
            break
    x, y = (uniform_filter1d(np.concatenate(each), round(RATE), axis=0) for each in (rows, rest))
    left = [y - x[:, :n] @ np.linalg.lstsq(x[:, :n], y, rcond=None)[0] for n in (2, 4)]
    slope = float(np.hypot(*np.linalg.lstsq(x, y, rcond=None)[0][2:])) / STANDARD_GRAVITY
    if slope < SLOPE or np.var(left[1]) > (1 - SHARED) * np.var(left[0]) or np.ptp(x[:, 2]) < 1.5:
        return log
    words = f"a_y minus V r changes with the heading as on a slope of {np.degrees(slope):.1f} deg"
    note = Note("warning", f"{log.name}: {words}: understeer and trim are less certain")
    return replace(log, notes=(*log.notes, note))
