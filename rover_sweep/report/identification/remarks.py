"""Sentences of the report on a result."""

from __future__ import annotations

from rover_sweep.data.recording import grouped_warnings
from rover_sweep.identification.acceptance import identified_runs, known_filters, usable
from rover_sweep.identification.fit import Estimate, FitResult
from rover_sweep.identification.pipeline import Identification
from rover_sweep.identification.verdicts import J_ACCEPTABLE, J_GOOD
from rover_sweep.report.identification.comparison import IGNORED
from rover_sweep.report.identification.handling_table import handling_notes
from rover_sweep.report.wording.number_format import SHORT_NAMES, number, percent, symbol, unit
from rover_sweep.report.wording.provenance import Provenance

SMALL_CHANGE = 3.0  # percent


def filters_remark(result: Identification) -> str | None:
    """Effect of ignoring the sensors' filters on the recommended model; None without filters or fit."""
    models = usable(result)
    order = (result.recommended, "roll-yaw", "bicycle", "kinematic")
    name = next((n for n in order if n in models and IGNORED in models[n].variants), None)
    if name is None:
        return None
    with_filters, without = models[name].fit, models[name].variants[IGNORED]
    costs = f"J_ave {without.average:.1f} without them, {with_filters.average:.1f} with them"
    changes = _changes(with_filters, without)
    if max(map(abs, changes.values()), default=0.0) < SMALL_CHANGE:
        return (
            f"A {name} fit that ignores the sensors' low-pass filters has the same cost ({costs}): the delay "
            f"absorbs their lag{_delays(with_filters, without)}, and no other parameter changes by "
            f"{SMALL_CHANGE:g} %."
        )
    if without.average > max(J_GOOD, 2 * with_filters.average):
        return (
            f"A {name} fit that ignores the sensors' low-pass filters is clearly worse ({costs})"
            f"{_delays(with_filters, without)}; it changes {_moved(changes)}."
        )
    return (
        f"A {name} fit that ignores the sensors' low-pass filters has a good cost ({costs}; guideline "
        f"≤ {J_GOOD:g}) but is wrong: the delay{_delays(with_filters, without)} and the inertia absorb the "
        f"filters' lag, which changes {_moved(changes)}."
    )


def _changes(fit: FitResult, other: FitResult) -> dict[str, float]:
    """Change [%] of each free parameter except the delay."""
    free = [e for e in fit.estimates if e.free and e.value and e.name not in fit.structure.delays]
    return {e.name: 100 * (other[e.name].value / e.value - 1) for e in free}


def _delays(fit: FitResult, other: FitResult) -> str:
    moved = [
        f"{symbol(n)} from {1000 * fit[n].value:.0f} to {1000 * other[n].value:.0f} ms"
        for n in fit.structure.delays
    ]
    return f" ({', '.join(moved)})" if moved else ""


def _moved(changes: dict[str, float]) -> str:
    order = sorted(changes, key=lambda n: -abs(changes[n]))[:3]
    words = [f"{symbol(n)} by {changes[n]:+.0f} %" for n in order]
    return words[0] if len(words) == 1 else ", ".join(words[:-1]) + " and " + words[-1]


def finding(result: Identification) -> str | None:
    """The recommended model in one line: parameters with intervals, verification; None without one."""
    model = result.models.get(result.recommended or "")
    if model is None:
        return None
    free = result.numbers or [e for e in model.fit.estimates if e.free]
    words = [f"{symbol(e.name)} {number(e.value, 3)} {unit(e.unit)} ({_uncertainty(e)})" for e in free]
    text = f"At {model.fit.speed:.2f} m/s: " + ", ".join(words)
    unseen = prediction_sentence(result)
    return f"{text}; {unseen}" if unseen else f"{text}."


def _uncertainty(e: Estimate) -> str:
    """The 90 % interval; the Cramer-Rao bound where none was computed."""
    if e.interval is None:
        return f"CR {percent(e.cr_percent)} %"
    return f"90 %: {number(e.interval.low, 3)} to {number(e.interval.high, 3)}"


def prediction_sentence(result: Identification) -> str | None:
    """How the recommended model predicts the first run that is not in its fit; None without one."""
    model = result.models.get(result.recommended or "")
    if model is None or not model.verification:
        return None
    v = model.verification[0]
    return f"on {v.run} (not in the fit) J_rms {number(v.j_rms, 3)} and TIC {number(v.tic, 2)}."


def diagnosis_remark(result: Identification) -> str | None:
    """Advice to diagnose if the recommended model misses one of its responses, else None."""
    model = usable(result).get(result.recommended or "")
    if model is None:
        return None
    output, cost = max(model.fit.costs.items(), key=lambda item: item[1], default=("", 0.0))
    if model.fit.average <= J_GOOD and cost <= J_ACCEPTABLE:
        return None
    return (
        f"J of {SHORT_NAMES.get(output, output)} is {cost:.0f}: use `rover-sweep diagnose` with the same "
        f"runs to find what the {result.recommended} model leaves out."
    )


def filters_known(result: Identification) -> str:
    """A sentence with the sensors' known low-pass filters."""
    known = known_filters(result)
    if not known:
        return "The recordings name no filter of their signals."
    words = [f"{SHORT_NAMES.get(c, c)} {number(f.cutoff_hz, 3)} Hz ({f.source})" for c, f in known.items()]
    return "Second-order low-pass filters included in the models' outputs: " + ", ".join(words) + "."


def to_do(result: Identification, provenance: Provenance) -> tuple[str, ...]:
    """What to do before using the numbers: runs to repeat, refused models, warnings, missing verification."""
    repeat = [f"{v.run}: {v.sentence}" for v in result.coherence if not v.keep]
    refused = [text if name in text else f"{name}: {text}" for name, text in result.refused.items()]
    runs = (*identified_runs(result), *provenance.verify_runs)
    missing = (
        ()
        if provenance.verify_runs
        else ("there is no run for verification: drive a doublet and give it with --verify",)
    )
    limits = [note.text for note in handling_notes(result, provenance.verify_runs)]
    wanted = dict.fromkeys([*repeat, *refused, *limits, *grouped_warnings(runs), *missing])
    said = " ".join(result.summary)
    return tuple(w for w in wanted if w.partition(": ")[2].removeprefix("discard: ") not in said)
