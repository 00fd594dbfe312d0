"""Before driving: what a set of runs would show of each effect, which look alike, and which runs to add.

No data is needed: the runs are simulated with the vehicle file's numbers and the noise of a small rover,
and what the nominal model cannot follow of each effect's signature is compared.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from rover_sweep.data.geometry import Geometry
from rover_sweep.data.tolerances import Tolerances
from rover_sweep.diagnosis.plans.plan_result import Limits, Plan, PlannedRun
from rover_sweep.diagnosis.plans.plan_sentences import answer, notes, settles
from rover_sweep.diagnosis.plans.proposals import allowed, candidates, first_set
from rover_sweep.diagnosis.plans.sets import Planner, Progress, Seen
from rover_sweep.diagnosis.simulation.experiment import Experiment

MOST_RUNS = 4  # to be proposed beside what is there
STEP = 0.1  # of one open point, by which a run that settles none must bring them nearer, for others to settle


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
    """What these runs tell of all effects, or of the wanted ones, and the fewest runs found that tell more.

    rad_per_us: road-wheel angle per us of servo output, positive. limits: of what is proposed. spread: of
    an ordinary rover. driven: {name of a run: what was recorded}, for those that were. progress is called
    with what is being done and the share done, 0..1. settled: {effect: why it is no longer looked for}.
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
    seen = planner.seen(base)
    chosen: tuple[PlannedRun, ...] = ()
    if seen.open:
        planner.simulate(more, (0.1, 0.7))
        chosen = _smallest(planner, now, _greedy(planner, base, more, seen))
    elif not now:
        chosen = base
    best = planner.seen((*now, *chosen)) if chosen else seen
    shown, runs_shown = (seen, now) if now else (best, chosen)
    drives, chosen = len(chosen), _counted(chosen)
    return Plan(
        now,
        planner.sizes(runs_shown, shown),
        shown.apart,
        planner.unseen(runs_shown, shown),
        chosen,
        _settled(planner, now, chosen),
        best.apart,
        answer(now, len(planner.asked), seen, best, drives),
        notes([r for r in now if not r.name and not allowed(r, rover, rad_per_us, limits)], limits),
    )


def _counted(runs: Sequence[PlannedRun]) -> tuple[PlannedRun, ...]:
    """Equal runs as one that is repeated."""
    return tuple(replace(run, repeat=runs.count(run)) for run in dict.fromkeys(runs))


def _greedy(
    planner: Planner, base: tuple[PlannedRun, ...], more: Sequence[PlannedRun], seen: Seen
) -> tuple[PlannedRun, ...]:
    """The set with runs added, each time the one that settles most, until none brings anything nearer."""
    found = base
    while seen.open and len(found) < len(base) + MOST_RUNS:
        planner.progress("choosing runs", 0.7 + 0.2 * (len(found) - len(base)) / MOST_RUNS)
        trials = [(run, planner.seen((*found, run))) for run in more]
        run, result = min(trials, key=lambda trial: trial[1].rank)
        nearer = result.open == seen.open and result.near >= seen.near + STEP
        if result.open >= seen.open and not nearer:
            break
        found, seen = (*found, run), result
    return found


def _smallest(
    planner: Planner, now: tuple[PlannedRun, ...], found: tuple[PlannedRun, ...]
) -> tuple[PlannedRun, ...]:
    """The runs beside those of now, without those that turned out not to be needed."""
    chosen = found[len(now) :] if now else found
    least = planner.seen(found).open
    for run in chosen:
        fewer = tuple(r for k, r in enumerate(chosen) if k != chosen.index(run))
        if (now or fewer) and planner.seen((*now, *fewer)).open <= least:
            chosen = fewer
    return chosen


def _settled(
    planner: Planner, now: tuple[PlannedRun, ...], chosen: tuple[PlannedRun, ...]
) -> tuple[str, ...]:
    """What each run settles beside those before it."""
    out = []
    for k, run in enumerate(chosen):
        before = (*now, *chosen[:k])
        out.append(
            settles(run, before, planner.seen(before) if before else None, planner.seen((*before, run)))
        )
    return tuple(out)
