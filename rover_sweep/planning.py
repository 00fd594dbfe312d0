"""From runs that were driven, or are thought of, to what the plan takes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rover_sweep.diagnosis.plan_types import Plan, PlannedRun
from rover_sweep.errors import UsageError
from rover_sweep.identify.recording import Recording
from rover_sweep.preparation import geometry_of
from rover_sweep.vehicle_file import Vehicle

BIAS_SHARE = 0.3  # of the amplitude, from which a sweep counts as one about a steering bias


def planned(runs: Sequence[PlannedRun], vehicle: Vehicle, wanted: Sequence[str] = ()) -> Plan:
    """What these runs can tell apart, of all effects or of the wanted ones, and which runs to add.

    UsageError for a vehicle file without steering, since an amplitude is then no angle.
    """
    from rover_sweep.diagnosis.plan import plan

    _, rad_per_us = vehicle.steering()
    return plan(tuple(runs), geometry_of(vehicle), abs(rad_per_us), tuple(wanted))


def merged(runs: Sequence[PlannedRun]) -> tuple[PlannedRun, ...]:
    """Equal runs as one that is repeated, in the order of their first."""
    found: dict[PlannedRun, int] = {}
    for run in runs:
        single = replace(run, repeat=1)
        found[single] = found.get(single, 0) + run.repeat
    return tuple(replace(run, repeat=n) for run, n in found.items())


def as_planned(run: Recording, vehicle: Vehicle) -> PlannedRun:
    """A run that was driven as one of a plan: amplitude and bias of its steering, speed, heading."""
    _, rad_per_us = vehicle.steering()
    steering = run.manoeuvre("delta").x / abs(rad_per_us)
    low, high = np.percentile(steering, (1, 99))
    amplitude, bias = float(high - low) / 2, -float(np.mean(steering))
    if "speed" not in run:
        raise UsageError(f"{run.name} has no speed, so it has no place in a plan")
    bent = run.kind == "sweep" and abs(bias) > BIAS_SHARE * amplitude
    return PlannedRun(
        "bias_sweep" if bent else run.kind, round(amplitude), round(run.mean_speed, 2), _heading(run),
        round(bias) if bent else 0.0, name=run.name,
    )  # fmt: skip


def _heading(run: Recording) -> float | None:
    """Mean direction of the drive [deg, clockwise from north], None where it is not recorded."""
    if "psi" not in run:
        return None
    psi = run.manoeuvre("psi").x
    return round(-math.degrees(math.atan2(np.mean(np.sin(psi)), np.mean(np.cos(psi))))) % 360.0
