"""Warnings of runs near the critical speed or the friction limit."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rover_sweep.data.geometry import FRICTION, GRAVITY, NEAR
from rover_sweep.data.recording import Note, Recording
from rover_sweep.identification.handling import PEAK, Handling


def warnings(
    found: Handling | None, runs: Sequence[Recording], friction: float | None = None
) -> tuple[Note, ...]:
    """Warnings of runs close to the critical speed or with a peak a_y close to the friction limit.

    found: gives the critical speed. friction: peak side force of the tyres over their load, 0.5 when None.
    a_y is V r, which holds neither the roll nor the vibration of an accelerometer's signal.
    """
    notes = []
    critical = found.get("critical_speed") if found else None
    for run in runs:
        if critical and (speed := _fastest(run)) > NEAR * critical:
            notes.append(
                f"{run.name}: {speed:.2f} m/s is {100 * speed / critical:.0f} % of the critical speed "
                f"{critical:.2f} m/s ({found.model if found else ''} model), above which the rover spins "
                "without countersteering: drive slower"
            )
        limit = (friction or FRICTION) * GRAVITY
        if (peak := peak_lateral_acceleration(run)) > NEAR * limit:
            source = "friction of the vehicle file" if friction else f"friction {FRICTION:g}, assumed"
            remedy = (
                "" if friction else ", or give the friction of the ground in the vehicle file if it is higher"
            )
            notes.append(
                f"{run.name}: a_y reaches {peak:.1f} m/s^2, {100 * peak / limit:.0f} % of the friction limit "
                f"{limit:.1f} m/s^2 ({source}), where tyres are not linear: reduce amplitude or speed{remedy}"
            )
    return tuple(Note("warning", text) for text in notes)


def _fastest(run: Recording) -> float:
    return float(np.percentile(np.abs(run.manoeuvre("speed").x), PEAK))


def peak_lateral_acceleration(run: Recording) -> float:
    """99th percentile of |V r| over the manoeuvre, m/s^2."""
    r, speed = run.manoeuvre("r"), run["speed"]
    return float(np.percentile(np.abs(r.x * np.interp(r.t, speed.t, speed.x)), PEAK))
