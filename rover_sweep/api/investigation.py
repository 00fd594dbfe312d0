"""An investigation: drive a run, diagnose all runs, and let the next run answer what is still open.

`investigation` yields each decision before anything is driven. A `RunDriver` does the driving: on a vehicle,
or on a simulated one. Nothing here connects to a vehicle.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from rover_sweep.api.diagnosis_input import Material, diagnosed, material
from rover_sweep.api.known_steering import known
from rover_sweep.data.geometry import FRICTION, GRAVITY, NEAR
from rover_sweep.data.recording import Recording
from rover_sweep.data.results import Progress
from rover_sweep.data.vehicle_file import Vehicle
from rover_sweep.data.vehicle_geometry import geometry_of, tolerances_of
from rover_sweep.design.demand import space
from rover_sweep.diagnosis.held_out import SWEPT
from rover_sweep.diagnosis.plans.plan import Odds, RunValue, effects_of, run_values
from rover_sweep.diagnosis.plans.planner import (
    USUAL_SPEED,
    Limits,
    Plan,
    PlannedRun,
    Planner,
    candidates,
    largest_amplitude,
    manoeuvre_for,
)
from rover_sweep.diagnosis.result import Diagnosis, DiagnosisSettings
from rover_sweep.diagnosis.simulation.experiment import experiment
from rover_sweep.errors import UsageError
from rover_sweep.files.documents import read_json, write_file
from rover_sweep.investigation.decide import SAME, Means, NextStep, first_run, next_step, told
from rover_sweep.report.wording import plain, strict_json

BIAS_SHARE = 0.3  # of the amplitude; a sweep with a larger mean is a sweep about a bias
SLOWEST, FASTEST = 0.8, 12.0  # m/s, of proposed runs


def plan_runs(
    runs: Sequence[PlannedRun],
    vehicle: Vehicle,
    wanted: Sequence[str] = (),
    driven: Sequence[Recording] = (),
    progress: Progress | None = None,
) -> Plan:
    """Which effects these runs can detect and separate, and which runs to add.

    wanted: effect ids, all effects if empty. Effects that a bench has settled are not looked for unless they
    are wanted. driven: the recordings of the runs that have a name. progress: called with the current step
    and the share done, 0 to 1. UsageError if the vehicle file has no steering scale, which turns an amplitude
    into an angle, or if no run can show any of the wanted effects.
    """
    from rover_sweep.diagnosis.plans.plan import plan

    geometry, (_, rad_per_us), usual = geometry_of(vehicle), vehicle.steering(), tolerances_of(vehicle)
    planner = Planner(geometry, abs(rad_per_us), wanted, usual, {}, lambda what, share: None)
    if wanted and not planner.asked:
        raise UsageError(
            f"no run can show {', '.join(wanted)} with the {planner.model.baseline} baseline of this plan; "
            f"choose from {', '.join(effect.id for effect in planner.effects)}"
        )
    bench = known(vehicle, usual)
    return plan(
        tuple(runs),
        geometry,
        abs(rad_per_us),
        planning_limits(vehicle),
        tuple(wanted),
        bench.spread,
        {run.name: experiment(run) for run in driven},
        progress,
        {effect: why for effect, why in bench.settled.items() if effect not in wanted},
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
    heading = None  # mean direction of the drive [deg, clockwise from north]
    if "psi" in run:
        psi = run.manoeuvre("psi").x
        heading = round(-math.degrees(math.atan2(np.mean(np.sin(psi)), np.mean(np.cos(psi))))) % 360.0
    return PlannedRun(
        "bias_sweep" if bent else "other" if run.kind == "throttle" else run.kind,
        round(amplitude),
        round(run.mean_speed, 2),
        heading,
        round(bias) if bent else 0.0,
        name=run.name,
    )


MOST_RUNS = 6
COMFORT = 0.75  # of the allowed lateral acceleration, for the first sweep
LARGEST_FIRST = 240.0  # us
MEASURED_US = 3.0  # us: a measured amplitude is that much less than the one driven
Diagnose = Callable[[Material], Diagnosis]


@dataclass(frozen=True)
class Bounds:
    """Limits of the person. runs: largest number; speed [m/s], amplitude_us [us]: largest.

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

    given: the recordings by their roles; runs: their names. told: information from the last run [bit], None
    if nothing was expected.
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
        """Drive this run once; True if it was completed."""
        ...

    def spent(self) -> str:
        """Why no more runs can be driven, such as an empty battery; "" if they can."""
        ...


def investigation(
    driver: RunDriver, vehicle: Vehicle, bounds: Bounds, diagnose: Diagnose | None = None
) -> Generator[Decision, None, None]:
    """Yield each decision; the run of a decision is driven when the next one is asked for.

    A run that did not come to its end counts as one of the allowed runs. The last decision has no run.
    """
    known_before: dict[tuple[str, ...], Diagnosis] = {}

    def once(given: Material) -> Diagnosis:
        """The same diagnosis for the same runs, as after a run that did not come to its end."""
        names = tuple(run.name for run in (*given.runs, *given.held_out))
        if names not in known_before:
            known_before[names] = (diagnose or _diagnose(vehicle))(given)
        return known_before[names]

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
    driven = []
    for planned in (as_planned(run, vehicle) for run in recordings):
        # At the largest speed if it nearly had it, so that choices do not follow every deviation.
        nearly = abs(planned.speed - bounds.speed) <= SAME * bounds.speed
        speed = bounds.speed if nearly else round(planned.speed, 1)
        driven.append(replace(planned, speed=speed, heading=planned.heading if bounds.headings else None))
    first = first_sweep(vehicle, bounds)
    means = Means(choices(driven or [first], vehicle, bounds), bounds.runs, spent)
    within = means if fits(first, vehicle, bounds.ground) else replace(means, choices=())
    if step := first_run(driven, first, within):
        return Decision(step)
    given = material(recordings, ())
    found = (diagnose or _diagnose(vehicle))(given)

    def ranked(odds: Odds) -> Sequence[RunValue]:
        spread = known(vehicle, tolerances_of(vehicle)).spread
        kept = {run.name: experiment(run) for run in recordings}
        _, rad_per_us = vehicle.steering()
        planner = Planner(
            geometry_of(vehicle), abs(rad_per_us), effects_of(odds), spread, kept, lambda what, share: None
        )
        settled = {e.id: "not asked" for e in planner.effects if e.id not in odds}
        return run_values(replace(planner, settled=settled), driven, means.choices, odds)

    step = next_step(found, driven, means, ranked)
    return Decision(step, found, given, tuple(run.name for run in recordings))


def _diagnose(vehicle: Vehicle) -> Diagnose:
    return lambda given: diagnosed(given, vehicle, DiagnosisSettings())


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
    """The next runs within limits and ground, of kinds that a diagnosis fits."""
    _, rad_per_us = vehicle.steering()
    limits = _limits(vehicle, bounds)
    found = candidates(driven, geometry_of(vehicle), abs(rad_per_us), limits)
    for speed in dict.fromkeys(run.speed for run in found):  # the sweep of the largest amplitude
        most = largest_amplitude(speed, limits.ay, geometry_of(vehicle), abs(rad_per_us)) if speed else 0.0
        found.append(PlannedRun("sweep", min(most, limits.amplitude_us), speed))
    kept = [
        run for run in found if run.kind in SWEPT and run.speed and (bounds.headings or run.heading is None)
    ]
    whole = (replace(run, amplitude_us=10.0 * ((run.amplitude_us + MEASURED_US) // 10.0)) for run in kept)
    return tuple(run for run in dict.fromkeys(whole) if fits(run, vehicle, bounds.ground))


def fits(run: PlannedRun, vehicle: Vehicle, ground: tuple[float, float] | None) -> bool:
    """True if the path of the run is within the ground [m]."""
    if ground is None:
        return True
    needed = space(manoeuvre_for(run), vehicle, run.speed)
    return needed.length <= ground[0] and needed.width <= ground[1]


DOCUMENT = "investigation.json"


def investigation_document(
    decisions: Sequence[Decision], earlier: Sequence[Mapping[str, Any]] = ()
) -> dict[str, Any]:
    """All steps in plain JSON types, those of an earlier call first.

    proposal and settles: the run to drive now and its reason, as in the JSON of `plan`. Of a step:
    expected_bits of its run, told_bits of the run before it.
    """
    step = decisions[-1].step
    own = [
        {
            "runs": decision.runs,
            "verdict": found.verdict if (found := decision.diagnosis) else None,
            "findings": [
                {"effect": f.effect, "look_alikes": f.look_alikes, "probability": f.probability}
                for f in (found.findings if found else ())
            ],
            "action": decision.step.action,
            "reason": decision.step.reason,
            "run": asdict(decision.step.run) if decision.step.run else None,
            "expected_bits": decision.step.bits,
            "told_bits": decision.told,
        }
        for decision in decisions
    ]
    return plain(
        {
            "format": "rover-sweep investigation",
            "format_version": 1,
            "settled": step.action == "settled",
            "action": step.action,
            "sentence": step.reason,
            "effects": step.effects,
            "proposal": [asdict(step.run)] if step.run else [],
            "settles": [step.reason] if step.run else [],
            "steps": [{"number": n, **one} for n, one in enumerate([*earlier, *own], 1)],
            "units": "amplitude_us, bias_us: us; speed: m/s; heading: deg clockwise from north, null for any",
        }
    )


def write_investigation(
    folder: Path, decisions: Sequence[Decision], earlier: Sequence[Mapping[str, Any]]
) -> Path:
    """Replace investigation.json in a folder; UsageError where it cannot be written."""
    return write_file(folder / DOCUMENT, strict_json(investigation_document(decisions, earlier)))


def steps_before(folder: Path) -> tuple[Mapping[str, Any], ...]:
    """The steps that an earlier call wrote into the folder; () without a document.

    UsageError for a damaged document, which would be lost when it is written again.
    """
    path = folder / DOCUMENT
    try:
        steps = read_json(path.read_text(encoding="utf-8"))["steps"]
        return tuple({k: v for k, v in step.items() if k != "number"} for step in steps)
    except (FileNotFoundError, NotADirectoryError):
        return ()
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise UsageError(
            f"{path} cannot be read as the steps of an investigation ({error}); rename it to keep it, "
            "or give another folder"
        ) from None
