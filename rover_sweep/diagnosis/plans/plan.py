"""Before driving: the detectable size of each effect, the effects that look alike, and the runs to add.

No data is needed. The runs are simulated with the numbers of the vehicle file and the noise of a small rover,
and the parts of the signatures that the nominal model cannot explain are compared.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from rover_sweep.data.geometry import Geometry
from rover_sweep.data.tolerances import Tolerances
from rover_sweep.diagnosis.plans.plan_result import Limits, Plan, PlannedRun
from rover_sweep.diagnosis.plans.plan_sentences import answer, notes, settles
from rover_sweep.diagnosis.plans.proposals import allowed, candidates, first_set
from rover_sweep.diagnosis.plans.sets import Planner, Progress, SetResult
from rover_sweep.diagnosis.simulation.experiment import Experiment

MOST_RUNS = 4  # proposed in addition to the given ones
STEP = 0.1  # of one open point: least progress of a run that does not settle a point itself


def plan(
    runs: Sequence[PlannedRun],
    rover: Geometry,
    rad_per_us: float,
    limits: Limits,
    wanted: Sequence[str] = (),
    spread: Tolerances | None = None,
    driven: Mapping[str, Experiment] | None = None,
    progress: Progress | None = None,
    settled: Mapping[str, str] | None = None,
) -> Plan:
    """Which effects these runs can detect and separate, and the smallest set of runs to add.

    wanted: effect ids, all effects if empty. rad_per_us: road-wheel angle per us of servo output, positive.
    limits: of the proposed runs. spread: normal tolerances of a rover. driven: {run name: recording} of the
    runs that were driven. progress: called with the current step and the share done, 0 to 1. settled:
    {effect: why it is not looked for}.
    """
    planner = Planner(
        rover,
        rad_per_us,
        wanted,
        spread or Tolerances(),
        driven or {},
        progress or (lambda what, share: None),
        settled or {},
    )
    now = tuple(runs)
    base = now or first_set(rover, rad_per_us, limits)
    more = candidates(base, rover, rad_per_us, limits)
    planner.simulate(base, (0.0, 0.1))
    given = planner.evaluate(base)
    chosen: tuple[PlannedRun, ...] = ()
    if given.open:
        planner.simulate(more, (0.1, 0.7))
        chosen = _smallest(planner, now, _greedy(planner, base, more, given))
    elif not now:
        chosen = base
    best = planner.evaluate((*now, *chosen)) if chosen else given
    shown, runs_shown = (given, now) if now else (best, chosen)
    drives, chosen = len(chosen), _counted(chosen)
    return Plan(
        now,
        planner.sizes(runs_shown),
        shown.look_alikes,
        planner.unseen(runs_shown, shown),
        chosen,
        _settled(planner, now, chosen),
        best.look_alikes,
        answer(now, len(planner.asked), given, best, drives),
        notes([r for r in now if not r.name and not allowed(r, rover, rad_per_us, limits)], limits),
    )


def _counted(runs: Sequence[PlannedRun]) -> tuple[PlannedRun, ...]:
    """Equal runs merged into one with a repeat count."""
    return tuple(replace(run, repeat=runs.count(run)) for run in dict.fromkeys(runs))


def _greedy(
    planner: Planner, base: tuple[PlannedRun, ...], more: Sequence[PlannedRun], current: SetResult
) -> tuple[PlannedRun, ...]:
    """The set with runs added, each time the one that settles most points, until none makes progress."""
    found = base
    while current.open and len(found) < len(base) + MOST_RUNS:
        planner.progress("choosing runs", 0.7 + 0.2 * (len(found) - len(base)) / MOST_RUNS)
        trials = [(run, planner.evaluate((*found, run))) for run in more]
        run, result = min(trials, key=lambda trial: trial[1].rank)
        nearer = result.open == current.open and result.near >= current.near + STEP
        if result.open >= current.open and not nearer:
            break
        found, current = (*found, run), result
    return found


def _smallest(
    planner: Planner, now: tuple[PlannedRun, ...], found: tuple[PlannedRun, ...]
) -> tuple[PlannedRun, ...]:
    """The runs added to the given ones, without those that are not needed."""
    chosen = found[len(now) :] if now else found
    least = planner.evaluate(found).open
    for run in chosen:
        fewer = tuple(r for k, r in enumerate(chosen) if k != chosen.index(run))
        if (now or fewer) and planner.evaluate((*now, *fewer)).open <= least:
            chosen = fewer
    return chosen


def _settled(
    planner: Planner, now: tuple[PlannedRun, ...], chosen: tuple[PlannedRun, ...]
) -> tuple[str, ...]:
    """One sentence for each run: what it adds to those before it."""
    out = []
    for k, run in enumerate(chosen):
        before = (*now, *chosen[:k])
        out.append(
            settles(
                run, before, planner.evaluate(before) if before else None, planner.evaluate((*before, run))
            )
        )
    return tuple(out)
