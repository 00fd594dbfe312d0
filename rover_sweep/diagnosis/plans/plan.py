"""Before driving: which effects a diagnosis of planned runs is expected to name, and the runs to add.

No data is needed. The runs are simulated with the numbers of the vehicle file and the noise of a small rover;
the expected probabilities follow from the weights that a diagnosis uses (`expected_posterior`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from rover_sweep.data.geometry import Geometry
from rover_sweep.data.tolerances import Tolerances
from rover_sweep.diagnosis.plans.detectable_sizes import detectable
from rover_sweep.diagnosis.plans.plan_result import Limits, Plan, PlannedRun
from rover_sweep.diagnosis.plans.planner import Planner, Progress, SetResult
from rover_sweep.diagnosis.plans.proposals import allowed, candidates, run_text
from rover_sweep.diagnosis.simulation.experiment import Experiment

LEAST_BITS = 0.1  # information for which a run is worth its drive
NAMED = 6  # effects that a sentence names


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
    """Which effects these runs can detect and separate, and the runs to add.

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
    planner.simulate(now, (0.0, 0.1))
    chosen = _chosen(planner, now, limits)
    sets = [(*now, *chosen[:k]) for k in range(len(chosen) + 1)]
    results = [planner.evaluate(each) for each in sets if each]
    shown = now or chosen
    given, best = results[0] if now else results[-1], results[-1]
    sizes = detectable(planner, shown)
    return Plan(
        now,
        sizes,
        given.look_alikes,
        planner.unseen(shown, [e for e in planner.asked if e not in sizes]),
        chosen,
        tuple(map(_tells, chosen, [None, *results] if not now else results, results[len(now) > 0 :])),
        best.look_alikes,
        _answer(bool(now), given, best, sum(run.repeat for run in chosen)),
        _notes([r for r in now if not r.name and not allowed(r, rover, rad_per_us, limits)], limits),
    )


def _chosen(planner: Planner, now: tuple[PlannedRun, ...], limits: Limits) -> tuple[PlannedRun, ...]:
    """The runs to add: each time the one with the most information, while it is worth its drive."""
    chosen: list[PlannedRun] = []
    result, done = planner.evaluate(now) if now else None, 0.1
    while result is None or len(result.separated) < len(planner.asked):
        around = candidates((*now, *chosen), planner.rover, planner.rad_per_us, limits)
        more = list(dict.fromkeys(planner.held(run, limits.ay) for run in around))
        planner.simulate(more, (done, 0.5 * (done + 0.85)))
        done = 0.5 * (done + 0.85)
        planner.progress("choosing runs", done)
        trials = [(run, planner.evaluate((*now, *chosen, run))) for run in more]
        run, better = max(trials, key=lambda trial: trial[1].bits)
        if result is not None and better.bits < result.bits + LEAST_BITS:
            break
        chosen, result = [*chosen, run], better
    return tuple(replace(run, repeat=chosen.count(run)) for run in dict.fromkeys(chosen))


def _answer(any_given: bool, given: SetResult, best: SetResult, added: int) -> tuple[str, ...]:
    """First what the given runs are expected to name, then what the proposal adds, then what stays open."""
    asked, count = len(best.sure), "1 run" if added == 1 else f"{added} runs"
    open_now = [e for e in best.sure if e not in best.separated]
    left = (f"not detected and separated at their usual size: {in_words(open_now)}",) if open_now else ()
    if not any_given:
        verb = "detects and separates" if added == 1 else "detect and separate"
        return (f"{count} {verb} {len(best.separated)} of {asked} effects", *left)
    first = f"these runs detect and separate {len(given.separated)} of {asked} effects"
    if not added:
        return (first, "no run was found that adds to this", *left) if left else (first,)
    more = count.replace("run", "more run")
    return (first, f"with {more} they detect and separate {len(best.separated)}", *left)


def _tells(run: PlannedRun, before: SetResult | None, after: SetResult) -> str:
    """What a run is expected to add to those before it."""
    new = [e for e in after.separated if before is None or e not in before.separated]
    bits = after.bits - (before.bits if before else 0.0)
    names = f"; detects and separates {in_words(new)}" if new else ""
    return f"{run_text(run)}: {bits:.1f} bit of information{names}"


def in_words(names: Sequence[str], last: str = "and") -> str:
    """The names as part of a sentence, those beyond `NAMED` as a number."""
    shown = [*names[:NAMED], *([f"{len(names) - NAMED} more"] if len(names) > NAMED else [])]
    return f"{', '.join(shown[:-1])} {last} {shown[-1]}" if len(shown) > 1 else "".join(shown)


def _notes(outside: Sequence[PlannedRun], limits: Limits) -> tuple[str, ...]:
    """The limits that the proposal keeps, and the given runs that exceed them."""
    kept = (
        f"proposed runs stay within {limits.ay:.1f} m/s^2 of lateral acceleration ({limits.why}), "
        f"{limits.amplitude_us:g} us, and {limits.speed[0]:g} to {limits.speed[1]:g} m/s"
    )
    return (
        kept,
        *(f"the {run_text(run)} exceeds these limits, so its result is not reliable" for run in outside),
    )
