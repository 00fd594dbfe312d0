"""Compares recordings with their simulation: do they agree, where do they differ, and in what?"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from threadpoolctl import threadpool_limits

from rover_sweep.comparison.answer import Agreement, Comparison, Difference, Verdict, answer_sentence
from rover_sweep.comparison.common_model import FittedSide, as_noisy, common_model, side_of
from rover_sweep.comparison.differences import (
    ALIKE,
    Found,
    Known,
    differences,
    differences_left,
    found_between,
)
from rover_sweep.comparison.direct import (
    Direct,
    Pair,
    bode_of_runs,
    direct,
    histories_of,
    instruments,
    pairs_by_steering,
    predicted,
    shared,
)
from rover_sweep.data.results import Progress
from rover_sweep.diagnosis.effects import EffectParameter, every_form, form_named
from rover_sweep.diagnosis.locate import mismatches
from rover_sweep.diagnosis.posterior.infer import Options, infer
from rover_sweep.diagnosis.posterior.upper_bounds import ONE_SIDED
from rover_sweep.diagnosis.problem.least_squares import signatures
from rover_sweep.diagnosis.result import UpperBound
from rover_sweep.diagnosis.search import screen, tangent
from rover_sweep.diagnosis.simulation.augmented import AugmentedModel
from rover_sweep.diagnosis.simulation.candidates import Model, possible
from rover_sweep.diagnosis.simulation.experiment import Experiment
from rover_sweep.errors import DataRefused

# How much each quantity and effect could still differ between simulation and recordings, at 95 %.


CLEAR = 30.0  # chi-squared of a difference; by chance rarer than 1 in 100 000 for 40 parameters
NEARLY, MOST = 0.3, 3  # share of the clearest one's chi-squared, and number, of suspects that are fitted
FAINT = 1e-3  # length of a signature that no data show


def could_differ(
    found: Found, recordings: FittedSide, simulation: FittedSide
) -> dict[str, dict[str, UpperBound]]:
    """{quantity or effect: {parameter: range of recordings minus simulation}}; some are relative."""
    out: dict[str, dict[str, UpperBound]] = {}
    for k, q in enumerate(found.candidates):
        if q.effect is None and k not in found.chosen:
            amount, sd = found.subsets.amount(k, found.chosen)
            low, high = amount - ONE_SIDED * sd, amount + ONE_SIDED * sd
            unit = "relative" if q.relative else next(iter(q.report(found.recordings[0]).values()))[1]
            out[q.name] = {q.name: UpperBound(unit, low, high, q.matters)}
    one, two = _amounts(recordings), _amounts(simulation)
    effects: dict[str, dict[str, UpperBound]] = {}
    for key in (k for k in one if k in two):
        (p, a, va), (_, b, vb) = one[key], two[key]
        sd = float(np.sqrt(va + vb))
        low, high = a - b - ONE_SIDED * sd, a - b + ONE_SIDED * sd
        bound = UpperBound(p.unit, low, high)
        if p.form == "inverse":  # of a limit or cut-off its value where the other side has none
            bound = UpperBound(p.unit, p.value(max(abs(low), abs(high))), None)
        effects.setdefault(key[0], {})[key[1]] = bound
    return {**out, **dict(sorted(effects.items()))}


def largest_score(side: FittedSide) -> float:
    """The largest drop of chi-squared that an effect outside the model predicts, to first order."""
    return max((a * a / v for _, a, v in _amounts(side).values()), default=0.0)


def suspects(recordings: FittedSide, simulation: FittedSide) -> tuple[str, ...]:
    """Effects outside of the model in which both sides differ clearly, nearly as clearly as in the first.

    A linear prediction hardly separates play from sticking, so fits decide.
    """
    one, two = _amounts(recordings), _amounts(simulation)
    clear = {k: (one[k][1] - two[k][1]) ** 2 / (one[k][2] + two[k][2]) for k in one if k in two}
    ranked = sorted(clear, key=lambda key: -clear[key])
    enough = max(CLEAR, NEARLY * clear[ranked[0]]) if ranked else 0.0
    return tuple(dict.fromkeys(effect for effect, p in ranked if clear[effect, p] > enough))[:MOST]


def _amounts(side: FittedSide) -> Mapping[tuple[str, str], tuple[EffectParameter, float, float]]:
    """{(effect, parameter): (parameter, coordinate, its variance)} of the effects that the model lacks."""
    runs = side.plain.runs
    effects = [e for e in possible(side.model, runs)[0] if not e.in_one_run]
    problem = side.problem
    space = tangent(side.fitted)
    found = signatures(problem, side.fitted, effects)
    parameters = {(e.id, p.name): p for e in effects for p in e.parameters if not p.nominal}
    left, variance = space.outside(side.fitted.rows), side.fitted.overdispersion
    out = {}
    for s in found:
        rows = space.outside(s.rows)
        power = float(rows @ rows)
        if (s.effect, s.parameter) in parameters and power >= FAINT:  # else the runs hardly show it
            amount = s.size * float(rows @ left) / power
            out[s.effect, s.parameter] = (
                parameters[s.effect, s.parameter],
                amount,
                s.size**2 * variance / power,
            )
    return out


# Effects in which simulation and recordings differ, though no diagnosis named them.


MOST_ADDED = 2  # effects that are added


def with_suspects(
    recorded: Sequence[Experiment],
    recordings: FittedSide,
    simulation: FittedSide,
    fitted: dict[tuple[str, ...], FittedSide],
) -> tuple[FittedSide, FittedSide, dict[str, tuple[str, ...]]]:
    """(recordings, simulation, {added effect: others that explain nearly as much}).

    Adds effects in which both sides differ clearly; of several, the one that fits best.
    recorded: the recorded runs. fitted: {laws and run: the recordings fitted with them}, used and filled.
    """
    alike: dict[str, tuple[str, ...]] = {}
    for _ in range(MOST_ADDED):
        tried: dict[str, tuple[FittedSide, FittedSide]] = {}
        for name in suspects(recordings, simulation):
            model = recordings.model.with_effect(name)
            if model.laws_and_run not in fitted:
                fitted[model.laws_and_run] = _with(recorded, recordings, name, model)
            sides = fitted[model.laws_and_run], _with(simulation.plain.runs, simulation, name, model)
            if not any(side.at_largest(name) for side in sides):
                tried[name] = sides
        if not tried:
            break
        before = _cost(recordings, simulation)
        gains = {name: before - _cost(*sides) for name, sides in tried.items()}
        best = max(gains, key=lambda name: gains[name])
        alike[best] = tuple(n for n, gain in gains.items() if n != best and gain > ALIKE * gains[best])
        recordings, simulation = tried[best]
    return recordings, simulation, alike


def _cost(one: FittedSide, two: FittedSide) -> float:
    return one.fitted.cost + two.fitted.cost


def _with(runs: Sequence[Experiment], side: FittedSide, name: str, model: Model) -> FittedSide:
    """The side fitted with the effect, from its linear prediction if there is one."""
    found = screen(side.problem, side.fitted, tangent(side.fitted), side.model, form_named(name))
    return side_of(runs, model, {**side.fitted.x, **(found.start if found else {})}, model.ids)


UNEXPLAINED = 1.6  # of what the differences leave
SOME_LEFT, SUSPICIOUS = 1.1, 20.0
"""Variance of a row and score of an effect from which effects are searched in a simulation.

A score above 20 by chance is rarer than 1 in 1000 for 40 parameters; the search itself decides."""
UNNAMED = (
    "the diagnosis of the recordings found something that is not in the list of effects, so no effect was "
    "looked for in the difference"
)


@dataclass(frozen=True, eq=False)
class Compared:
    """A comparison with the data for pictures and corrections.

    used, unused: the pairs whose recorded runs were used and held out, with their differences. left: the rest
    of differences that were corrected before.
    """

    answer: Comparison
    used: Direct
    unused: Direct | None
    left: tuple[Difference, ...] = ()


@threadpool_limits.wrap(limits=1, user_api="blas")  # both cores are used by the simulations
def compare(
    recorded: Sequence[Experiment],
    held_out: Sequence[Experiment],
    simulated: Sequence[Experiment],
    model: AugmentedModel,
    effects: Sequence[str] | None = None,
    seed: int = 1,
    progress: Progress = lambda what, share: None,
    stop: Callable[[], bool] = lambda: False,
    fitted: dict[tuple[str, ...], FittedSide] | None = None,
    unnamed: bool = False,
    measured: Known = MappingProxyType({}),
    changed: Collection[str] = (),
) -> Compared:
    """Compare simulated runs with the recorded runs of the same steering.

    held_out: recorded runs that no fit has used. model: of the recordings, from their diagnosis.
    effects: names of the laws in the simulation, None: unknown, to be searched. fitted:
    {laws: the recordings fitted with them}, filled and used if the same recordings are compared several
    times; then without bounds and pictures. unnamed: the diagnosis found something without a name, so
    differences that it did not name stay unnamed. measured: differences of numbers measured on the rover from
    the simulation's. changed: quantities that were corrected by the same recordings before. DataRefused if a
    simulated run has the steering of no recording, or if only held-out runs were simulated.
    """
    started = time.monotonic()
    progress("comparing simulation and recordings", 0.0)
    every, kept_out = pairs_by_steering((*recorded, *held_out), simulated), {id(run) for run in held_out}
    pairs = [p for p in every if id(p.recorded) not in kept_out]
    held = [p for p in every if id(p.recorded) in kept_out]
    if not pairs:
        raise DataRefused(
            "only held-out runs were simulated; simulate at least one of the runs that are not held out too"
        )
    options, known = Options((), (), progress, stop), pairs
    pairs, held = [shared(p) for p in pairs], [shared(p) for p in held]
    known_fits = {} if fitted is None else fitted
    recordings, simulation = _sides(pairs, model, effects, options, known_fits)
    alike: Mapping[str, tuple[str, ...]] = {}
    if not unnamed:
        runs = [p.recorded for p in pairs]
        recordings, simulation, alike = with_suspects(runs, recordings, simulation, known_fits)
    progress("comparing simulation and recordings", 0.8)
    found = found_between(recordings, simulation, seed, measured)
    clear, minor = differences(found)
    clear = tuple(replace(d, look_alikes=(*d.look_alikes, *alike.get(d.name, ()))) for d in clear)
    plain = direct(pairs, recordings, simulation)
    unused = direct(held, recordings, simulation) if held else None
    agreement = (*plain.agreement(False), *(unused.agreement(True) if unused else ()))
    verdict = _verdict(clear, agreement, recordings, simulation)
    answer = Comparison(
        verdict,
        answer_sentence(verdict, clear, agreement),
        mismatches(plain.problem, plain.rows) if verdict != "agree" else (),
        () if verdict == "agree" else clear,
        minor,
        clear if verdict == "agree" else (),
        instruments(known, recordings.plain.floor, simulation.plain.floor),
        agreement,
        remarks=(*_far_off(simulation), *([UNNAMED] if unnamed else [])),
        seconds=time.monotonic() - started,
    )
    if fitted is None:
        swept = predicted(plain, recordings, found, False)
        shown = predicted(unused, recordings, found, True) if unused else swept
        answer = replace(
            answer,
            could_differ=could_differ(found, recordings, simulation),
            overlays=histories_of(shown),
            bode=bode_of_runs((*shown, *swept)),
        )
    left = differences_left(found, recordings, simulation, measured, changed)
    return Compared(answer, plain, unused, left)


def _sides(
    pairs: Sequence[Pair],
    model: AugmentedModel,
    effects: Sequence[str] | None,
    options: Options,
    fitted: dict[tuple[str, ...], FittedSide],
) -> tuple[FittedSide, FittedSide]:
    """Recordings and simulation fitted with the common model."""
    recorded, raw = [p.recorded for p in pairs], [p.simulated for p in pairs]

    def recordings(common: Model, begin: Mapping[str, float]) -> FittedSide:
        if common.laws_and_run not in fitted:
            laws = [(name, form_named(name)) for name in common.effects]
            # without the event there is no instant at which it could be fitted
            has = [law.id for name, law in laws if name in model.effects or not law.in_one_run]
            fitted[common.laws_and_run] = side_of(recorded, common, begin, has)
        return fitted[common.laws_and_run]

    seen = any({"p", "ay"} & set(run.measured) for run in recorded)
    common = common_model(model, effects or (), seen)
    first = recordings(common, model.x)
    has = None if effects is None else [form_named(name).id for name in effects]
    own = side_of(raw, common, first.fitted.x, has)
    simulated = as_noisy(raw, own.plain.floor, first.plain.floor)
    if any(a is not b for a, b in zip(simulated, raw, strict=True)):
        own = side_of(simulated, common, own.fitted.x, has)
    more_in_it = own.fitted.overdispersion > SOME_LEFT or largest_score(own) > SUSPICIOUS
    if effects is not None or not more_in_it:
        return first, own
    if common.happened_in:  # a model has one run in which a law begins
        once = {law.id for law in every_form().values() if law.in_one_run}
        options = replace(options, without=(*options.without, *once))
    more = infer(simulated, common, first.fitted.x, options)
    both = common_model(model, [n.law.name for n in more.named], seen)
    if both.effects == common.effects:
        return first, own
    has = [form_named(name).id for name in both.effects]
    where, partners = more.last.model, {p.simulated.name: p.recorded.name for p in pairs}
    theirs, ours = (
        replace(both, happened_in=run or both.happened_in, happened_order=where.happened_order)
        for run in (where.happened_in, partners.get(where.happened_in, ""))
    )
    return recordings(ours, first.fitted.x), side_of(simulated, theirs, more.last.fitted.x, has)


def _far_off(simulation: FittedSide) -> tuple[str, ...]:
    """A sentence if the recordings' model does not fit the simulation."""
    ends = simulation.at_bounds
    if not ends:
        return ()
    return (
        "the recordings' model does not fit the simulation: the fit ends at the bounds of "
        f"{', '.join(ends)}, so its numbers are not reliable; compare a simulation with roll, with its "
        "sensors at the IMU, and with the filters of the recordings",
    )


def _verdict(
    clear: Sequence[Difference],
    agreement: Sequence[Agreement],
    recordings: FittedSide,
    simulation: FittedSide,
) -> Verdict:
    """Agree if all runs do in all channels, whatever the fits say, or if all do and no fit says otherwise."""
    if all(a.agrees_everywhere for a in agreement) or (not clear and all(a.agrees for a in agreement)):
        return "agree"
    unexplained = any(side.fitted.overdispersion > UNEXPLAINED for side in (recordings, simulation))
    unexplained |= bool(simulation.at_bounds)
    far = not all(a.agrees for a in agreement)
    return "differ" if clear and not (unexplained and far) else "differ for an unknown reason"
