"""An investigation: drive a run, diagnose all runs, and let the next run answer what is still open.

`investigation` yields each decision before anything is driven. A `RunDriver` does the driving: on a vehicle,
or on a simulated one. Nothing here connects to a vehicle.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

from rover_sweep.api.diagnosis_input import Material, diagnosed, material
from rover_sweep.api.known_steering import known
from rover_sweep.api.plan import as_planned, planning_limits
from rover_sweep.data.recording import Recording
from rover_sweep.data.vehicle_file import Vehicle
from rover_sweep.data.vehicle_geometry import geometry_of, tolerances_of
from rover_sweep.design.demand import space
from rover_sweep.diagnosis.plans.next_run import Odds, RunValue, effects_of, run_values
from rover_sweep.diagnosis.plans.plan_result import Limits, PlannedRun
from rover_sweep.diagnosis.plans.planner import Planner
from rover_sweep.diagnosis.plans.proposals import candidates, largest_amplitude, manoeuvre_for
from rover_sweep.diagnosis.result import Diagnosis
from rover_sweep.diagnosis.settings import DiagnosisSettings
from rover_sweep.diagnosis.simulation.experiment import experiment
from rover_sweep.errors import UsageError
from rover_sweep.investigation.decide import SAME, first_run, next_step
from rover_sweep.investigation.next_step import Means, NextStep
from rover_sweep.investigation.open_questions import told

MOST_RUNS = 6
USUAL_SPEED = 2.4  # m/s
COMFORT = 0.75  # of the allowed lateral acceleration, for the first sweep
LARGEST_FIRST = 240.0  # us
MEASURED_US = 3.0  # us: a measured amplitude is that much less than the one driven
FITTED_KINDS = ("sweep", "bias_sweep", "multisine")  # a doublet is held out; nothing drives on blocks
Diagnose = Callable[[Material], Diagnosis]


@dataclass(frozen=True)
class Bounds:
    """What the person allows. runs: largest number; speed [m/s], amplitude_us [us]: largest.

    slowest [m/s]: no run is slower. ground: (length, width) [m] in the direction of the drive, None if it is
    not limited. headings: whether a person can turn the rover before a run.
    """

    runs: int = MOST_RUNS
    speed: float = USUAL_SPEED
    amplitude_us: float | None = None
    ground: tuple[float, float] | None = None
    headings: bool = True
    slowest: float = 0.0


@dataclass(frozen=True, eq=False)
class Decision:
    """A step with the diagnosis it follows from, None before the first.

    given: the recordings by their roles; runs: their names. told: information of the last run [bit], None
    where nothing was expected of it.
    """

    step: NextStep
    diagnosis: Diagnosis | None = None
    given: Material | None = None
    runs: tuple[str, ...] = ()
    told: float | None = None


class RunDriver(Protocol):
    """Drives single runs; asks the person before each if the vehicle is real."""

    def recordings(self) -> tuple[Recording, ...]:
        """The complete runs so far, in the order driven, each with its steering angle."""
        ...

    def drive(self, run: PlannedRun) -> bool:
        """Drive this run once; whether it came to its end."""
        ...

    def spent(self) -> str:
        """Why nothing more can be driven, such as an empty battery; "" while something can."""
        ...


def investigation(
    driver: RunDriver, vehicle: Vehicle, bounds: Bounds, diagnose: Diagnose | None = None
) -> Generator[Decision, None, None]:
    """Yield each decision; the run of a decision is driven when the next one is asked for.

    A run that did not come to its end counts as one of the allowed runs. The last decision has no run.
    """
    once = _remembered(diagnose or _diagnose(vehicle))
    tried, before = len(driver.recordings()), Decision(NextStep("open", ""))
    while True:
        left = replace(bounds, runs=bounds.runs - tried)
        decision = decided(driver.recordings(), vehicle, left, driver.spent(), once)
        if before.step.bits is not None and decision.diagnosis and decision.runs != before.runs:
            decision = replace(decision, told=told(before.step.odds, decision.diagnosis))
        yield decision
        before = decision
        if decision.step.run is None:
            return
        driver.drive(decision.step.run)
        tried += 1


def _remembered(diagnose: Diagnose) -> Diagnose:
    """The same diagnosis for the same runs, as after a run that did not come to its end."""
    known: dict[tuple[str, ...], Diagnosis] = {}

    def again(given: Material) -> Diagnosis:
        names = tuple(run.name for run in (*given.runs, *given.held_out))
        if names not in known:
            known[names] = diagnose(given)
        return known[names]

    return again


def decided(
    recordings: Sequence[Recording],
    vehicle: Vehicle,
    bounds: Bounds,
    spent: str = "",
    diagnose: Diagnose | None = None,
) -> Decision:
    """The decision after these runs. bounds.runs: runs that may still be driven. diagnose: default settings.

    UsageError if the vehicle file has no steering scale.
    """
    driven = [_at_usual_speed(as_planned(run, vehicle), bounds) for run in recordings]
    first = first_sweep(vehicle, bounds)
    means = Means(choices(driven or [first], vehicle, bounds), bounds.runs, spent)
    if step := first_run(driven, first, _fitting_first(means, first, vehicle, bounds)):
        return Decision(step)
    given = material(recordings, ())
    found = (diagnose or _diagnose(vehicle))(given)
    step = next_step(found, driven, means, _ranking(recordings, driven, means, vehicle))
    return Decision(step, found, given, tuple(run.name for run in recordings))


def _diagnose(vehicle: Vehicle) -> Diagnose:
    return lambda given: diagnosed(given, vehicle, DiagnosisSettings())


def _ranking(
    recordings: Sequence[Recording], driven: Sequence[PlannedRun], means: Means, vehicle: Vehicle
) -> Callable[[Odds], Sequence[RunValue]]:
    def ranked(odds: Odds) -> Sequence[RunValue]:
        spread = known(vehicle, tolerances_of(vehicle)).spread
        kept = {run.name: experiment(run) for run in recordings}
        _, rad_per_us = vehicle.steering()
        planner = Planner(
            geometry_of(vehicle), abs(rad_per_us), effects_of(odds), spread, kept, lambda what, share: None
        )
        settled = {e.id: "not asked" for e in planner.effects if e.id not in odds}
        return run_values(replace(planner, settled=settled), driven, means.choices, odds)

    return ranked


def _limits(vehicle: Vehicle, bounds: Bounds) -> Limits:
    usual = planning_limits(vehicle)
    amplitude = min(bounds.amplitude_us or usual.amplitude_us, usual.amplitude_us)
    slowest = min(max(usual.speed[0], bounds.slowest), bounds.speed)
    return replace(usual, amplitude_us=amplitude, speed=(slowest, bounds.speed))


def first_sweep(vehicle: Vehicle, bounds: Bounds) -> PlannedRun:
    """The first sweep: at the largest allowed speed, with an amplitude well within the limits."""
    _, rad_per_us = vehicle.steering()
    limits = _limits(vehicle, bounds)
    most = largest_amplitude(bounds.speed, COMFORT * limits.ay, geometry_of(vehicle), abs(rad_per_us))
    if most < 20.0:
        raise UsageError(
            f"at {bounds.speed:g} m/s a sweep within {limits.ay:.1f} m/s^2 has less than 20 us; "
            "give a smaller --speed"
        )
    return PlannedRun("sweep", min(most, LARGEST_FIRST, limits.amplitude_us), bounds.speed)


def choices(driven: Sequence[PlannedRun], vehicle: Vehicle, bounds: Bounds) -> tuple[PlannedRun, ...]:
    """The runs that limits and ground allow next; those that a diagnosis fits."""
    _, rad_per_us = vehicle.steering()
    limits = _limits(vehicle, bounds)
    found = candidates(driven, geometry_of(vehicle), abs(rad_per_us), limits)
    found += [_largest(speed, vehicle, limits) for speed in dict.fromkeys(run.speed for run in found)]
    kept = [
        run
        for run in found
        if run.kind in FITTED_KINDS and run.speed and (bounds.headings or run.heading is None)
    ]
    whole = (replace(run, amplitude_us=10.0 * ((run.amplitude_us + MEASURED_US) // 10.0)) for run in kept)
    return tuple(run for run in dict.fromkeys(whole) if fits(run, vehicle, bounds.ground))


def _at_usual_speed(run: PlannedRun, bounds: Bounds) -> PlannedRun:
    """The run at the largest speed if it nearly had it, so that choices do not follow every deviation."""
    nearly = abs(run.speed - bounds.speed) <= SAME * bounds.speed
    speed = bounds.speed if nearly else round(run.speed, 1)
    return replace(run, speed=speed, heading=run.heading if bounds.headings else None)


def _largest(speed: float, vehicle: Vehicle, limits: Limits) -> PlannedRun:
    """The sweep of the largest amplitude within the limits at a speed [m/s]."""
    _, rad_per_us = vehicle.steering()
    most = largest_amplitude(speed, limits.ay, geometry_of(vehicle), abs(rad_per_us)) if speed else 0.0
    return PlannedRun("sweep", min(most, limits.amplitude_us), speed)


def fits(run: PlannedRun, vehicle: Vehicle, ground: tuple[float, float] | None) -> bool:
    """True if the path of the run is within the ground [m]."""
    if ground is None:
        return True
    needed = space(manoeuvre_for(run), vehicle, run.speed)
    return needed.length <= ground[0] and needed.width <= ground[1]


def _fitting_first(means: Means, first: PlannedRun, vehicle: Vehicle, bounds: Bounds) -> Means:
    return means if fits(first, vehicle, bounds.ground) else replace(means, choices=())
