"""From runs to a diagnosis: locate the misfit, select effects, test the model on held-out runs."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from math import exp, log

from threadpoolctl import threadpool_limits

from rover_sweep.data.geometry import Geometry
from rover_sweep.data.recording import Recording
from rover_sweep.data.results import ByName, Progress
from rover_sweep.diagnosis.effects import library
from rover_sweep.diagnosis.held_out import HeldOutRun, compare_held_out, overlays, worse_channels
from rover_sweep.diagnosis.locate import mismatches
from rover_sweep.diagnosis.posterior.infer import (
    SHARE,
    Inference,
    Judged,
    Named,
    Options,
    baseline_of,
    infer,
    without_refuted,
)
from rover_sweep.diagnosis.posterior.parameter_intervals import (
    UNBOUNDED,
    draw_coordinates,
    effect_values,
    holds_absence,
    implausible_numbers,
    rover_numbers,
)
from rover_sweep.diagnosis.posterior.speed_loss import ID as SPEED
from rover_sweep.diagnosis.posterior.speed_loss import WORSE, earned, speed_finding, speed_loss, unknown_loss
from rover_sweep.diagnosis.posterior.unnamed import answer_curves
from rover_sweep.diagnosis.posterior.upper_bounds import upper_bounds
from rover_sweep.diagnosis.problem.least_squares import Fitted
from rover_sweep.diagnosis.problem.noise_floor import WINDOW, has_floor, smoothed_channels
from rover_sweep.diagnosis.result import (
    START,
    Baseline,
    Diagnosis,
    DiagnosisSettings,
    Falsified,
    Finding,
    HeldOut,
    Unknown,
    Unseen,
)
from rover_sweep.diagnosis.search import MANY, at_the_end, many_at_the_end
from rover_sweep.diagnosis.simulation import candidates as lumped_baseline
from rover_sweep.diagnosis.simulation.augmented import augmented
from rover_sweep.diagnosis.simulation.candidates import Model, has_roll, is_included
from rover_sweep.diagnosis.simulation.experiment import Experiment, experiment, in_order
from rover_sweep.diagnosis.simulation.single_track import must_compile
from rover_sweep.diagnosis.unexplained import FoundLaws, in_model, left_unexplained, with_laws_of
from rover_sweep.diagnosis.verdict import (
    NOTABLE,
    change_in_runs,
    refuted_words,
    remarks_of,
    sentence_of,
    turn_sentence,
    turn_with,
    verdict_of,
    why_it_does_not_matter,
)
from rover_sweep.errors import DataRefused, UsageError
from rover_sweep.identification.grouping import Group, Settings, grouped
from rover_sweep.identification.model_results import determined_model

STOPPED = "not tried, because the diagnosis was stopped"


@threadpool_limits.wrap(limits=1, user_api="blas")  # both cores are used by the simulations
def diagnose(
    runs: Sequence[Recording],
    rover: Geometry,
    settings: DiagnosisSettings,
    held_out_runs: Sequence[Recording] = (),
    simulated: Sequence[Recording] = (),
    progress: Progress | None = None,
    stop: Callable[[], bool] | None = None,
    groups: Sequence[Group] = (),
) -> Diagnosis:
    """Find the physics that a baseline lacks, from recordings with steering angles (SI units, ISO axes).

    held_out_runs: used neither for the fit nor for the selection. simulated: recordings of a simulation; the
    simplest model that reproduces them is then the baseline. progress(activity, share done 0..1); stop:
    True ends the search with the results so far. groups: the runs by speed, where that is known. DataRefused
    if the data allow no identification; UsageError if rover or baseline do not support the settings.
    """
    started = time.monotonic()
    limit = settings.time_limit

    def stopped() -> bool:
        late = limit is not None and time.monotonic() - started > limit
        return late or (stop is not None and stop())

    groups = groups or grouped(runs, Settings())
    if simulated:
        baseline: Baseline = baseline_of([experiment(run) for run in simulated], rover)
    else:
        baseline = settings.baseline or determined_model(groups, rover)[0]
    _refuse(runs, rover, baseline, groups)
    every = in_order([experiment(run) for run in (*runs, *held_out_runs)])
    used, held = every[: len(runs)], every[len(runs) :]
    _refuse_without_floor(used)
    model = Model(baseline, rover, settings.spread, two_clocks=any(r.two_clocks for r in used))
    options = Options(
        settings.with_effects, settings.without_effects, progress or (lambda what, share: None), stopped
    )
    speed = sum(run.mean_speed for run in used) / len(used)
    begin = _start(settings.parameters) | lumped_baseline.start_coordinates(settings.parameters, speed)
    if must_compile():
        options.progress("compiling the simulation, once on this machine (up to a minute)", 0.0)
    judged = without_refuted(infer(used, model, begin, options, held), held)
    found = judged[0]
    options.progress("describing the residual", 0.92)  # of the work
    answer, laws = _answer(judged, used, held, settings)
    remarks = [f"the simulation follows the {baseline} model"] if simulated else []
    remarks += smoothed_channels(found.last.problem.floor)
    if found.stopped and limit is not None and time.monotonic() - started > limit:
        remarks.append(f"stopped by the time limit of {limit:g} s, before all effects were tried")
    whole = augmented(found.last.model, found.last.closest.x, runs, [run.begin for run in used])
    whole = in_model(whole, laws) if laws else whole
    remarks += answer.remarks
    return replace(answer, seconds=time.monotonic() - started, remarks=tuple(remarks), model=whole)


def _refuse(runs: Sequence[Recording], rover: Geometry, baseline: Baseline, groups: Sequence[Group]) -> None:
    if baseline == "roll-yaw" and not has_roll(rover):
        raise UsageError(
            "the roll-yaw model needs sprung_mass, cg_height_above_roll_centre and roll_inertia in the "
            "vehicle file; add them or use --baseline bicycle"
        )
    if not runs:
        raise DataRefused("all runs are held out; give at least one run to diagnose")
    for group in groups:
        if why := group.why_not():
            raise DataRefused(why)


def _refuse_without_floor(used: Sequence[Experiment]) -> None:
    """DataRefused if the steering excites all frequencies in all frames: there is no noise floor then."""
    if not has_floor(used):
        longest = max(float(run.t[-1]) for run in used)
        raise DataRefused(
            f"the runs are too short to find their noise floor: the longest has {longest:.1f} s; the "
            f"noise at a frequency needs {WINDOW:g} s without steering at that frequency; drive a whole sweep"
        )


def _start(parameters: Mapping[str, float]) -> dict[str, float]:
    """Start {coordinate: value} of the fit from {parameter: SI value} of an identified model."""
    known = {n: log(v) for n in START if (v := parameters.get(n, 0.0)) > 0}
    out = {f"ln_{n}": v for n, v in known.items() if n not in ("Cf", "Cr")}
    if "Cf" in known and "Cr" in known:
        out |= {"ln_C": 0.5 * (known["Cf"] + known["Cr"]), "ln_ratio": known["Cf"] - known["Cr"]}
    return out


def _answer(
    judged: Judged, used: Sequence[Experiment], held: Sequence[Experiment], settings: DiagnosisSettings
) -> tuple[Diagnosis, FoundLaws | None]:
    """(the diagnosis without its model, the unnamed laws that the model will include)."""
    found, held_out, rests, refuted = judged
    none, last = found.none, found.last
    floor = last.problem.floor
    drawn = draw_coordinates(last, settings.seed)
    nominal, full = none.closest, last.closest
    minor = dict.fromkeys(found.minor, "it is below the size that matters")
    findings: list[Finding] = []
    for named in found.named:
        turn = turn_with(named.law.id, full, last.problem.runs)
        change = change_in_runs(named.law.id, full, last.problem.runs)
        if why := why_it_does_not_matter(holds_absence(named.law, drawn), turn, change):
            minor[named.law.id] = why
            continue
        worth = tuple(compare_held_out(run, rests[named.law.id], full) for run in held_out)
        findings.append(_finding(named, found, drawn, worth, turn_sentence(turn)))
    not_judged, gains, slowed, unknown = _speed_answer(found, used, held_out, full, settings)
    findings += slowed
    places = mismatches(none.problem.plain, none.closest.rows)
    left = None if found.stopped else left_unexplained(found, bool(findings)) or unknown
    left, laws = with_laws_of(left, last, held_out, found.families) if left else (left, None)
    variance = last.fitted.data_cost / last.problem.size
    whole = laws.fitted if laws else full
    if laws:  # the numbers that are said are those of the model that is kept
        last = replace(last, problem=last.problem.plain, closest=laws.fitted, fitted=laws.fitted)
        drawn = draw_coordinates(last, settings.seed)
    total = tuple(compare_held_out(run, nominal, whole) for run in held_out)
    if [f.effect for f in findings] == [SPEED]:  # the models driven with it
        total = findings[0].held_out
    cannot_see = tuple(Unseen(e, why) for e, why in {**last.cannot_see, **not_judged}.items())
    weighed = found.posterior
    # a model that is wrong bounds nothing
    if not found.stopped and not laws and weighed.something_else < 0.5:
        cannot_see += upper_bounds(last, settings.with_effects, settings.without_effects)
    ends = {} if found.stopped else at_the_end(last.problem, last.fitted)
    gaps = mismatches(last.problem.plain, last.closest.rows) if len(ends) >= MANY else ()
    doubts = (*implausible_numbers(last, drawn), *many_at_the_end(ends, gaps))
    measure = doubts or tuple(ends.values())
    compared = {run.run.name: worse_channels(run, nominal, full) for run in held_out}
    worse = {name: channels for name, channels in compared.items() if channels} if findings else {}
    settled = {*minor, *refuted, *(f.effect for f in findings)}
    possible = {e: p for e, p in weighed.effects.items() if p >= SHARE and e not in settled}
    answer = Diagnosis(
        # a model with doubtful numbers explains nothing, however well it fits
        verdict=verdict_of(findings, left, variance, found.stopped or bool(doubts), bool(worse)),
        sentence=sentence_of(findings, left, variance, found.stopped, measure, bool(minor), possible),
        baseline=last.model.baseline,
        mismatch=places,
        findings=tuple(findings),
        unknown=left,
        cannot_see=cannot_see,
        falsified=_falsified(found) if findings else (),
        parameters=ByName(rover_numbers(last, settings.seed)),
        curves=() if found.stopped else answer_curves(last, drawn),
        scores={**found.gains, **gains},
        overlays=overlays(held or used[:1], bool(held), nominal, whole, floor),
        held_out=total,
        remarks=(*remarks_of(used, findings, minor, possible, worse), *map(refuted_words, refuted.items())),
        runs=tuple(r.name for r in used),
        held_out_runs=tuple(r.name for r in held),
        p_none=weighed.none,
        p_else=weighed.something_else,
    )
    return answer, laws


def _speed_answer(
    found: Inference,
    used: Sequence[Experiment],
    held_out: Sequence[HeldOutRun],
    full: Fitted,
    settings: DiagnosisSettings,
) -> tuple[dict[str, str], dict[str, float], tuple[Finding, ...], Unknown | None]:
    """Speed lost in turns: ({effect: why it cannot be judged}, {effect: gain}, findings, unknown).

    Judged only if the fitted motion is good enough to give the drag of the turned wheels.
    """
    last = found.last
    if last.model.lumped:
        why = "the lumped model has no front tyre force, whose drag is needed"
        return {SPEED: why}, {}, (), None
    if found.stopped:
        judged = set(found.gains) | set(last.cannot_see)
        left = (e.id for e in library().values() if not (e.id in judged or is_included(e, last.model)))
        return dict.fromkeys(left, STOPPED), {}, (), None
    unnamed = found.posterior.something_else >= 0.5
    if unnamed or max(last.misfit.values(), default=1.0) > NOTABLE:
        why = "the motion is not explained, so the drag of the turned wheels is not known"
        return {SPEED: why}, {}, (), None
    lost = speed_loss(used, last.model, last.fitted.x, settings.seed)
    if not settings.candidates((SPEED,)):
        return {}, {}, (), unknown_loss(lost) if lost.found else None
    gains = {SPEED: max(lost.gain, 0.0)}
    finding = speed_finding(lost, full, held_out) if lost.found else None
    if finding and not earned(finding):
        return {SPEED: WORSE}, gains, (), None
    return {}, gains, (finding,) if finding else (), None


def _finding(
    named: Named, found: Inference, drawn: list[dict[str, float]], held_out: tuple[HeldOut, ...], turn: str
) -> Finding:
    effect, values = named.law, effect_values(named.law, found.last, drawn)
    others = {f"probability:{e}": p for e, p in named.alternatives.items()}
    several = len(found.last.model.laws(effect.id)) > 1 and effect.form
    title = f"{effect.title} (form: {effect.form})" if several else effect.title
    other = f" (or {', '.join(library()[e].title for e in named.alternatives)})" if named.alternatives else ""
    numbers = ", ".join(
        f"{v.name} = {v.value:.3g} {v.unit}".rstrip(" -") for v in values if v.value < UNBOUNDED
    )
    return Finding(
        effect=effect.id,
        look_alikes=tuple(named.alternatives),
        parameters=ByName(values),
        evidence={"gain": named.gain, **others},
        held_out=held_out,
        next_run=effect.next_run,
        sentence=f"{title}{other}, {numbers}",
        equation=effect.equation,
        form=effect.form,
        probability=named.probability,
        turn=turn,
    )


def _falsified(found: Inference) -> tuple[Falsified, ...]:
    """Nominal parameters that changed by more than 3 % when the effects were added."""
    before, after = found.none.fitted.x, found.last.fitted.x
    return tuple(
        Falsified(c.parameter, c.unit, exp(before[c.name]), exp(after[c.name]))
        for c in found.last.fitted.free
        if c.parameter and c.name in before and abs(before[c.name] - after[c.name]) > 0.03
    )
