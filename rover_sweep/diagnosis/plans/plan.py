"""Before driving: which effects a diagnosis of planned runs is expected to name, and the runs to add.

No data is needed. The runs are simulated with the numbers of the vehicle file and the noise of a small rover;
the expected probabilities follow from the weights that a diagnosis uses (`expected_posterior`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import sqrt

import numpy as np

from rover_sweep.data.geometry import Geometry, Tolerances
from rover_sweep.data.results import Progress
from rover_sweep.diagnosis.plans.expected_posterior import NONE, OTHER, Assumed, Expected, RunSet, expected
from rover_sweep.diagnosis.plans.planner import (
    DetectableSize,
    Limits,
    Plan,
    PlannedRun,
    Planner,
    allowed,
    candidates,
    run_text,
)
from rover_sweep.diagnosis.posterior.infer import SURE
from rover_sweep.diagnosis.posterior.upper_bounds import reported_value
from rover_sweep.diagnosis.search import least_size
from rover_sweep.diagnosis.simulation.experiment import Experiment

# Detectable sizes: from which a diagnosis of these runs is expected to name an effect.


PASSES = 8  # bisections, of a range of sizes of 256: to 2 %


def detectable(planner: Planner, runs: Sequence[PlannedRun]) -> dict[str, DetectableSize]:
    """{asked effect: detectable size of its first parameter}, without undetectable effects.

    By bisection of the logarithm of the size. The runs are simulated at each size, since the signature of a
    limit grows faster than the size.
    """
    given = planner.assumed
    low = dict.fromkeys(planner.asked, 1.0 / 16.0)
    high = {e: min(16.0, given.reach[e, given.first(e).name].most) for e in planner.asked}
    sure = dict.fromkeys(planner.asked, False)
    for n in range(PASSES):
        planner.progress("computing detectable sizes", 0.85 + 0.15 * n / PASSES)
        tried = {e: sqrt(low[e] * high[e]) for e in planner.asked}
        p = expected(planner.together(runs, tried), planner.asked).sure
        for effect, size in tried.items():
            named = p[effect] >= SURE
            sure[effect] |= named
            (high if named else low)[effect] = size
    return {e: _shown(given, e, high[e]) for e in planner.asked if sure[e]}


def _shown(given: Assumed, effect: str, times: float) -> DetectableSize:
    """The size for a user; times: in units of the reach."""
    law, p = given.effects[effect], given.first(effect)
    reach, least = given.reach[effect, p.name], least_size(law, p, given.model, given.x)
    way = 1.0 if reach.distance > 0.0 else -1.0
    size = max(way * (reach.start + times * reach.distance) / p.per, least)
    name, unit, value = reported_value(law, p, way * size)
    return DetectableSize(name, unit, value, reported_value(law, p, way * least)[2] if least > 0.0 else None)


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
    """Adds the run with the most information, one by one, while it is worth driving."""
    chosen: list[PlannedRun] = []
    result, done = planner.evaluate(now) if now else None, 0.1
    while result is None or len(result.separated) < len(planner.asked):
        around = candidates((*now, *chosen), planner.rover, planner.rad_per_us, limits)
        more = list(dict.fromkeys(planner.held(run, limits.ay) for run in around))
        planner.simulate(more, (done, 0.5 * (done + 0.85)))
        done = 0.5 * (done + 0.85)
        planner.progress("choosing runs", done)
        trials = [(run, planner.evaluate((*now, *chosen, run))) for run in more]
        run, better = max(trials, key=lambda trial: trial[1].information())
        if result is not None and better.information() < result.information() + LEAST_BITS:
            break
        chosen, result = [*chosen, run], better
    return tuple(replace(run, repeat=chosen.count(run)) for run in dict.fromkeys(chosen))


def _answer(any_given: bool, given: Expected, best: Expected, added: int) -> tuple[str, ...]:
    """Sentences on the effects that the given runs show, that the proposal adds, and that stay open."""
    asked, count = len(best.truths) - 1, "1 run" if added == 1 else f"{added} runs"
    open_now = [e for e in best.truths if e not in (NONE, *best.separated)]
    left = (f"not detected and separated at their usual size: {in_words(open_now)}",) if open_now else ()
    if not any_given:
        verb = "detects and separates" if added == 1 else "detect and separate"
        return (f"{count} {verb} {len(best.separated)} of {asked} effects", *left)
    first = f"these runs detect and separate {len(given.separated)} of {asked} effects"
    if not added:
        return (first, "no run was found that adds to this", *left) if left else (first,)
    more = count.replace("run", "more run")
    return (first, f"with {more} they detect and separate {len(best.separated)}", *left)


def _tells(run: PlannedRun, before: Expected | None, after: Expected) -> str:
    """What a run is expected to add to those before it."""
    new = [e for e in after.separated if before is None or e not in before.separated]
    bits = after.information() - (before.information() if before else 0.0)
    names = f"; detects and separates {in_words(new)}" if new else ""
    return f"{run_text(run)}: {bits:.1f} bit of information{names}"


def in_words(names: Sequence[str], last: str = "and") -> str:
    """The first `NAMED` names as part of a sentence, and how many more."""
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


# The run to add to driven ones: what each choice is expected to tell about the explanations left open.


Odds = Mapping[str, float]
"""{explanation: its probability after the driven runs}, of effects, NONE and OTHER; need not sum to 1."""


@dataclass(frozen=True)
class RunValue:
    """The expected value of one more run.

    bits: information on the open explanations. settles: effects that it is expected to confirm if they are
    present.
    """

    run: PlannedRun
    bits: float
    settles: tuple[str, ...] = ()


def effects_of(odds: Odds) -> tuple[str, ...]:
    """The effects among the explanations."""
    return tuple(e for e in odds if e not in (NONE, OTHER))


def run_values(
    planner: Planner, driven: Sequence[PlannedRun], choices: Sequence[PlannedRun], odds: Odds
) -> tuple[RunValue, ...]:
    """The choices that are worth driving, the best first.

    Each effect has the size for which the driven runs are expected to give its present probability.
    """
    truths = [e for e, p in odds.items() if e in {NONE, *planner.asked} and p > 0.0]
    if len(truths) < 2:
        return ()
    planner.simulate(driven, (0.0, 0.2))
    planner.simulate(choices, (0.2, 0.9))
    now = planner.together(driven)
    amounts = [_amount(now, e, odds[e]) for e in truths]
    before, found = expected(now, truths, amounts), []
    share = sum(odds[e] for e in truths) / sum(odds.values())
    for run in choices:
        after = expected(planner.together((*driven, run)), truths, amounts)
        settles = tuple(e for e in effects_of(after.sure) if after.sure[e] >= SURE > before.sure[e])
        bits = share * (after.information(odds) - before.information(odds))
        found.append(RunValue(run, bits, settles))
    return tuple(sorted((v for v in found if v.bits >= LEAST_BITS), key=lambda v: v.bits, reverse=True))


def _amount(runs: RunSet, effect: str, probability: float) -> float:
    """Least amount of an effect, in units of its reach, with this expected probability; at most its end."""
    if effect == NONE:
        return 0.0
    tried = np.geomspace(1.0 / 16.0, 4.0, 13)
    found = expected(runs, [effect] * tried.size, tried.tolist())
    p = np.array([share[effect] for share in found.shares])
    return float(tried[np.argmax(p >= min(probability, np.max(p)))])
