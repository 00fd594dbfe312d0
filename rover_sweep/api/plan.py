"""From runs that were driven, or are thought of, to what the plan takes."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from rover_sweep.api.known_steering import known
from rover_sweep.data.geometry import GRAVITY
from rover_sweep.data.material_sizes import tolerances_of
from rover_sweep.data.recording import Recording
from rover_sweep.data.vehicle_file import Vehicle
from rover_sweep.data.vehicle_geometry import geometry_of
from rover_sweep.diagnosis.plans.plan_result import Limits, Plan, PlannedRun
from rover_sweep.errors import UsageError
from rover_sweep.identification.handling import FRICTION, NEAR

BIAS_SHARE = 0.3  # of the amplitude, from which a sweep counts as one about a steering bias
SLOWEST, FASTEST = 0.8, 12.0  # m/s, of a run that is proposed


def plan_runs(
    runs: Sequence[PlannedRun],
    vehicle: Vehicle,
    wanted: Sequence[str] = (),
    driven: Sequence[Recording] = (),
    progress: Callable[[str, float], None] | None = None,
) -> Plan:
    """What these runs can tell apart, of all effects or of the wanted ones, and which runs to add. What a
    bench has settled is no longer looked for, unless it is wanted.

    driven: the recordings of those runs that have a name. UsageError for a vehicle file without steering,
    since an amplitude is then no angle, and where nothing of what is wanted can be missing.
    """
    from rover_sweep.diagnosis.plans.plan import plan
    from rover_sweep.diagnosis.simulation.experiment import experiment

    _, rad_per_us = vehicle.steering()
    _refuse_nothing_wanted(wanted, vehicle)
    bench = known(vehicle, tolerances_of(vehicle.material))
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
    """UsageError where no run could show any of the wanted effects beside the plan's baseline."""
    from rover_sweep.diagnosis.plans.sets import Planner

    geometry, (_, rad_per_us) = geometry_of(vehicle), vehicle.steering()
    planner = Planner(
        geometry, abs(rad_per_us), wanted, tolerances_of(vehicle.material), {}, lambda what, share: None
    )
    if wanted and not planner.asked:
        raise UsageError(
            f"no run can show {', '.join(wanted)} beside the {planner.model.baseline} model that the plan is "
            f"about; want others, of {', '.join(effect.id for effect in planner.effects)}"
        )


def planning_limits(vehicle: Vehicle) -> Limits:
    """What may be proposed: within the friction that the report warns at, and the applet's own limits."""
    from rover_sweep.design.advice import PWM_MAX

    friction = vehicle.friction.value if vehicle.friction else FRICTION
    source = "of the vehicle file" if vehicle.friction else "assumed, for the vehicle file has none"
    why = f"{100 * NEAR:.0f} % of the friction limit, friction {friction:g} {source}"
    return Limits(NEAR * friction * GRAVITY, float(PWM_MAX), (SLOWEST, FASTEST), why)


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
        "bias_sweep" if bent else run.kind,
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
