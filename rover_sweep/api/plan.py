"""Plans runs: turns recorded or intended runs and a vehicle file into the input of a plan."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from rover_sweep.api.known_steering import known
from rover_sweep.data.geometry import FRICTION, GRAVITY, NEAR
from rover_sweep.data.recording import Recording
from rover_sweep.data.vehicle_file import Vehicle
from rover_sweep.data.vehicle_geometry import geometry_of, tolerances_of
from rover_sweep.diagnosis.plans.plan_result import Limits, Plan, PlannedRun
from rover_sweep.errors import UsageError

BIAS_SHARE = 0.3  # of the amplitude; a sweep with a larger mean is a sweep about a bias
SLOWEST, FASTEST = 0.8, 12.0  # m/s, of proposed runs


def plan_runs(
    runs: Sequence[PlannedRun],
    vehicle: Vehicle,
    wanted: Sequence[str] = (),
    driven: Sequence[Recording] = (),
    progress: Callable[[str, float], None] | None = None,
) -> Plan:
    """Which effects these runs can detect and separate, and which runs to add.

    wanted: effect ids, all effects if empty. Effects that a bench has settled are not looked for unless they
    are wanted. driven: the recordings of the runs that have a name. progress: called with the current step
    and the share done, 0 to 1. UsageError if the vehicle file has no steering scale, which turns an amplitude
    into an angle, or if no run can show any of the wanted effects.
    """
    from rover_sweep.diagnosis.plans.plan import plan
    from rover_sweep.diagnosis.simulation.experiment import experiment

    _, rad_per_us = vehicle.steering()
    _refuse_nothing_wanted(wanted, vehicle)
    bench = known(vehicle, tolerances_of(vehicle))
    settled = {effect: why for effect, why in bench.settled.items() if effect not in wanted}
    return plan(
        tuple(runs),
        geometry_of(vehicle),
        abs(rad_per_us),
        planning_limits(vehicle),
        tuple(wanted),
        bench.spread,
        {run.name: experiment(run) for run in driven},
        progress,
        settled,
    )


def _refuse_nothing_wanted(wanted: Sequence[str], vehicle: Vehicle) -> None:
    """UsageError if no run can show any of the wanted effects with the baseline of the plan."""
    from rover_sweep.diagnosis.plans.planner import Planner

    geometry, (_, rad_per_us) = geometry_of(vehicle), vehicle.steering()
    planner = Planner(geometry, abs(rad_per_us), wanted, tolerances_of(vehicle), {}, lambda what, share: None)
    if wanted and not planner.asked:
        raise UsageError(
            f"no run can show {', '.join(wanted)} with the {planner.model.baseline} baseline of this plan; "
            f"choose from {', '.join(effect.id for effect in planner.effects)}"
        )


def planning_limits(vehicle: Vehicle) -> Limits:
    """Limits of proposed runs: the friction share at which the report warns, and the limits of the applet."""
    from rover_sweep.design.advice import PWM_MAX

    friction = vehicle.friction.value if vehicle.friction else FRICTION
    source = "of the vehicle file" if vehicle.friction else "assumed, since the vehicle file gives none"
    why = f"{100 * NEAR:.0f} % of the friction limit, friction {friction:g} {source}"
    return Limits(NEAR * friction * GRAVITY, float(PWM_MAX), (SLOWEST, FASTEST), why)


def merged(runs: Sequence[PlannedRun]) -> tuple[PlannedRun, ...]:
    """Equal runs merged into one with a repeat count, in their first order."""
    found: dict[PlannedRun, int] = {}
    for run in runs:
        single = replace(run, repeat=1)
        found[single] = found.get(single, 0) + run.repeat
    return tuple(replace(run, repeat=n) for run, n in found.items())


def as_planned(run: Recording, vehicle: Vehicle) -> PlannedRun:
    """A recorded run as a run of a plan: amplitude and bias of its steering, speed, heading.

    UsageError if it has no speed.
    """
    _, rad_per_us = vehicle.steering()
    steering = run.manoeuvre("delta").x / abs(rad_per_us)
    low, high = np.percentile(steering, (1, 99))
    amplitude, bias = float(high - low) / 2, -float(np.mean(steering))
    if "speed" not in run:
        raise UsageError(f"{run.name} has no recorded speed, which a plan needs")
    bent = run.kind == "sweep" and abs(bias) > BIAS_SHARE * amplitude
    return PlannedRun(
        "bias_sweep" if bent else "other" if run.kind == "throttle" else run.kind,
        round(amplitude),
        round(run.mean_speed, 2),
        _heading(run),
        round(bias) if bent else 0.0,
        name=run.name,
    )


def _heading(run: Recording) -> float | None:
    """Mean direction of the drive [deg, clockwise from north], None where it is not recorded."""
    if "psi" not in run:
        return None
    psi = run.manoeuvre("psi").x
    return round(-math.degrees(math.atan2(np.mean(np.sin(psi)), np.mean(np.cos(psi))))) % 360.0
