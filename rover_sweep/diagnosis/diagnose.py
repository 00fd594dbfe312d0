"""From runs to a diagnosis: locate, name, model, show."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from math import exp, log

import numpy as np

from rover_sweep.data.geometry import Geometry
from rover_sweep.data.recording import Recording
from rover_sweep.diagnosis.choose import Choice, Named, choose
from rover_sweep.diagnosis.effects import library
from rover_sweep.diagnosis.held_out.speed_finding import ID as SPEED
from rover_sweep.diagnosis.held_out.speed_finding import speed_finding, unknown_loss
from rover_sweep.diagnosis.held_out.speed_loss import speed_loss
from rover_sweep.diagnosis.held_out.worth import Fresh, Modelled, held_out, overlays, refitted_without
from rover_sweep.diagnosis.locate.locate import mismatches
from rover_sweep.diagnosis.problem.noise_floor import WINDOW, quiet_frames
from rover_sweep.diagnosis.result import Diagnosis, EffectValue, Falsified, Finding, HeldOut, Unseen
from rover_sweep.diagnosis.search.bounds import unknown_beyond
from rover_sweep.diagnosis.search.look_alikes import Alike
from rover_sweep.diagnosis.search.parameter_intervals import draws, effect_values, nominal_values
from rover_sweep.diagnosis.search.rounds import Options
from rover_sweep.diagnosis.search.simulation_rung import followed
from rover_sweep.diagnosis.settings import DiagnosisSettings
from rover_sweep.diagnosis.simulation import lumped_baseline
from rover_sweep.diagnosis.simulation.augmented import augmented
from rover_sweep.diagnosis.simulation.candidates import Model
from rover_sweep.diagnosis.simulation.experiment import Experiment, experiment
from rover_sweep.diagnosis.unexplained.unexplained import standing_out, unknown
from rover_sweep.diagnosis.verdict import remarks_of, sentence_of, verdict_of
from rover_sweep.errors import DataRefused, UsageError
from rover_sweep.identification.grouping import Settings, grouped

Progress = Callable[[str, float], None]
STOPPED = "not tried: the diagnosis was stopped before"
MATERIAL_CHANGE = 0.03  # of a nominal parameter, from which it is told as falsified


def diagnose(
    runs: Sequence[Recording],
    rover: Geometry,
    settings: DiagnosisSettings,
    held_out_runs: Sequence[Recording] = (),
    simulated: Sequence[Recording] = (),
    progress: Progress | None = None,
    stop: Callable[[], bool] | None = None,
) -> Diagnosis:
    """What was left out of a baseline, from recordings with steering angles.

    simulated: recordings of a simulation; the plainest model that it follows is then the baseline.
    DataRefused where nothing can be identified from the runs; UsageError for what is not offered.
    """
    begun = time.monotonic()
    limit = settings.time_limit

    def stopped() -> bool:
        late = limit is not None and time.monotonic() - begun > limit
        return late or (stop is not None and stop())

    _refuse(runs, rover, settings)
    if simulated:
        settings = replace(settings, baseline=followed([experiment(run) for run in simulated], rover))
    used = [experiment(run) for run in runs]
    _refuse_without_floor(used)
    fresh = [experiment(run) for run in held_out_runs]
    model = Model(settings.baseline, rover, settings.spread, two_clocks=any(r.two_clocks for r in used))
    options = Options(
        settings.with_effects,
        settings.without_effects,
        settings.seed,
        progress or (lambda what, share: None),
        stopped,
    )
    speed = sum(run.mean_speed for run in used) / len(used)
    begin = _start(settings.parameters) | lumped_baseline.start(settings.parameters, speed)
    choice = choose(used, model, begin, options)
    found = _answer(choice, used, fresh, settings)
    told = [f"the simulation follows the {settings.baseline} model"] if simulated else []
    if choice.stopped and limit is not None and time.monotonic() - begun > limit:
        told.append(f"stopped by the time limit of {limit:g} s, before all effects were tried")
    whole = augmented(choice.last.model, choice.last.fitted.x, runs, [run.begin for run in used])
    return replace(found, seconds=time.monotonic() - begun, remarks=(*told, *found.remarks), model=whole)


def _refuse(runs: Sequence[Recording], rover: Geometry, settings: DiagnosisSettings) -> None:
    if settings.baseline == "roll-yaw" and not (rover.sprung_mass and rover.h and rover.roll_inertia):
        raise UsageError(
            "the roll-yaw model needs sprung_mass, cg_height_above_roll_centre and roll_inertia in the "
            "vehicle file; add them or take --baseline bicycle"
        )
    if not runs:
        raise DataRefused("no run is left to diagnose; give a run beside those that are held out")
    for group in grouped(runs, Settings()):
        if why := group.why_not():
            raise DataRefused(why)


def _refuse_without_floor(used: Sequence[Experiment]) -> None:
    """DataRefused where no frame of any run is beside its excitation: nothing tells a residual from noise."""
    if not np.any(quiet_frames(used)[1]):
        longest = max(float(run.t[-1]) for run in used)
        raise DataRefused(
            f"the runs are too short to find their noise floor: the longest has {longest:.1f} s, and "
            f"{WINDOW:g} s are needed in which a frequency is not steered; drive a whole sweep"
        )


def _start(parameters: Mapping[str, float]) -> dict[str, float]:
    """Coordinates to begin from, out of an identified model's parameters."""
    out = {f"ln_{n}": log(v) for n in ("Izz", "k_phi", "b_phi", "C") if (v := parameters.get(n, 0.0)) > 0}
    cf, cr = parameters.get("Cf", 0.0), parameters.get("Cr", 0.0)
    if cf > 0 and cr > 0:
        out |= {"ln_C": 0.5 * log(cf * cr), "ln_ratio": log(cf / cr)}
    return out


def _answer(
    choice: Choice, used: Sequence[Experiment], fresh: Sequence[Experiment], settings: DiagnosisSettings
) -> Diagnosis:
    first, last = choice.first, choice.last
    drawn = draws(last, settings.seed)
    whole = Modelled(first.model, first.fitted.x), Modelled(last.model, last.fitted.x)
    floor = last.problem.floor
    unused = tuple(Fresh.of(run, floor, whole[1]) for run in fresh)
    shown = tuple(held_out(run, *whole) for run in unused)
    findings = tuple(_finding(n, choice, drawn, unused, whole) for n in choice.named)
    gains = {t.effect: max(t.gain, 0.0) for t in first.trials}
    unseen, slower = dict(last.unseen), None
    if last.model.lumped:  # no front force, whose own drag is to be told from a loss
        unseen[SPEED] = "its derivatives hold no force of the front wheels"
    elif choice.stopped:
        unseen |= {e.id: STOPPED for e in library().values() if e.id not in gains and e.id not in unseen}
    elif any(left.much for left in last.left.values()):  # the own drag is that of a model that holds
        unseen[SPEED] = "the motion is not explained, without which the wheels' own drag is not known"
    else:
        lost = speed_loss(used, last.model.structure, last.fitted.x, settings.seed)
        if not settings.candidates((SPEED,)):
            slower = unknown_loss(lost) if lost.found else None
        else:
            gains[SPEED] = max(lost.gain, 0.0)
            findings += (speed_finding(lost, whole[1], unused),) if lost.found else ()
    if [f.effect for f in findings] == [SPEED]:  # nothing else changed the model
        shown = findings[0].held_out
    places = mismatches(first.problem.plain, first.closest.rows)
    left = None
    if not choice.stopped:
        left = unknown(last, bool(findings), settings.seed, choice.nameless) or slower
    if choice.beyond:
        left = unknown_beyond(choice.beyond, choice.withdrawn)
    if not (left or findings or choice.stopped):
        left = standing_out(places)
    variance = last.fitted.data_cost / last.problem.size
    pictures = fresh or used[:1]
    return Diagnosis(
        verdict_of(findings, left, variance, choice.stopped),
        sentence_of(findings, left, variance, choice.stopped),
        settings.baseline,
        places,
        findings,
        left,
        tuple(Unseen(e, why) for e, why in unseen.items()),
        _falsified(choice) if findings else (),
        nominal_values(last, drawn),
        gains,
        overlays(pictures, bool(fresh), *whole, floor),
        shown,
        remarks_of(used, findings, () if choice.beyond else choice.withdrawn, choice.nameless),
        0.0,
        tuple(r.name for r in used),
        tuple(r.name for r in fresh),
    )


def _finding(
    named: Named,
    choice: Choice,
    drawn: list[dict[str, float]],
    unused: Sequence[Fresh],
    whole: tuple[Modelled, Modelled],
) -> Finding:
    effect, last = library()[named.trial.effect], choice.last
    values = effect_values(effect, last, drawn)
    evidence = {"gain": named.trial.gain, "threshold": named.threshold}
    evidence |= {f"cosine:{a.effect}": a.cosine for a in named.alike}
    return Finding(
        effect.id,
        tuple(a.effect for a in named.alike),
        values,
        evidence,
        _worth(effect.id, choice, unused, whole),
        effect.next_run,
        _told(effect.title, values, named.alike),
        effect.equation,
    )


def _worth(
    effect: str, choice: Choice, unused: Sequence[Fresh], whole: tuple[Modelled, Modelled]
) -> tuple[HeldOut, ...]:
    """What one effect is worth in the presence of all others: the whole model with it and without it."""
    if not unused:
        return ()
    nominal, full = whole
    alone = len(choice.named) == 1
    rest = nominal if alone else refitted_without(effect, choice.last.problem, full)
    return tuple(held_out(run, rest, full) for run in unused)


def _told(title: str, values: Sequence[EffectValue], alike: Sequence[Alike]) -> str:
    numbers = ", ".join(f"{v.name} = {v.value:.3g} {v.unit}".rstrip(" -") for v in values if v.value < 1e9)
    other = f" (or {', '.join(library()[a.effect].title for a in alike)})" if alike else ""
    return f"{title}{other}, {numbers}"


def _falsified(choice: Choice) -> tuple[Falsified, ...]:
    """Nominal parameters that moved when the effects were taken in."""
    before, after = choice.first.fitted.x, choice.last.fitted.x
    return tuple(
        Falsified(c.parameter, c.unit, exp(before[c.name]), exp(after[c.name]))
        for c in choice.last.fitted.free
        if c.parameter and c.name in before and abs(before[c.name] - after[c.name]) > MATERIAL_CHANGE
    )
