"""What is said of a result: handling, the sensors' filters, how it predicts, and what to do first."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rover_sweep.data.recording import Note, Recording, grouped_warnings
from rover_sweep.data.results import Quantity, number
from rover_sweep.diagnosis.verdict import NOTABLE
from rover_sweep.identification.fit import FitResult
from rover_sweep.identification.handling import UNITS, Handling, warnings
from rover_sweep.identification.model_results import UNTIED, ModelResult
from rover_sweep.identification.pipeline import TITLES, Identification, identified_runs, known_filters, usable
from rover_sweep.identification.verdicts import J_ACCEPTABLE, J_GOOD
from rover_sweep.report.document import Cell, Cells, Table, table_of
from rover_sweep.report.identification.tables import IGNORED
from rover_sweep.report.wording import SHORT_NAMES, SI, Provenance, ShownUnits, symbol, unit

# Handling quantities as a table, as warnings and for identification.json.


NOTABLE_BEND = 0.04  # relative change of a stiffness between amplitudes that is told
LABELS = {
    "understeer_gradient_deg_per_g": "understeer gradient K_us",
    "static_margin": "static margin",
    "critical_speed": "critical speed",
    "characteristic_speed": "characteristic speed",
    "yaw_rate_gain": "steady r/δ",
    "lateral_acceleration_gain": "steady a_y/δ",
    "yaw_frequency": "yaw mode, frequency",
    "yaw_damping": "yaw mode, damping",
    "yaw_time_constant": "yaw mode, time constant",
    "roll_frequency": "roll mode, frequency",
    "roll_damping": "roll mode, damping",
    "roll_time_constant": "roll mode, time constant",
}


def handling_table(result: Identification, units: ShownUnits = SI) -> Table | None:
    """One column per model with tyres, of its fit with Cf and Cr free; None without any."""
    found = _told(result)
    if not found:
        return None
    rows: list[Cells] = [
        (
            LABELS[name],
            units.words(unit(UNITS[name][0])),
            *(_cell(h.told.get(name), units.factor(UNITS[name][0])) for h in found.values()),
        )
        for name in LABELS
        if any(name in h.told for h in found.values())
    ]
    headings = ("", "", *(TITLES.get(name, name) for name in found))
    sentences = "; ".join(f"{TITLES.get(name, name)}: {h.sentence}" for name, h in found.items())
    note = (
        f"{sentences}. From fits with Cf, Cr and a lag of the steering free; K_us of the numbers of the "
        "rover, from which the steady gains follow; the modes are the model's own. K_us > 0: understeer. "
        "Intervals: Cramér-Rao bound (modes: bootstrap), and what speed lost in turns, large steering angles "
        "and 3 % of steering scale change in r/δ."
    )
    speed = next(iter(found.values())).speed
    return table_of(f"Handling at {speed:.2f} m/s", headings, rows, note, 2)


def _told(result: Identification) -> dict[str, Handling]:
    """{model: handling of its fit with Cf and Cr free, else of its only fit}."""
    found = result.handling
    return {n: found.get(f"{n}, {UNTIED}", h) for n, h in found.items() if n in result.models}


def _cell(q: Quantity | None, factor: float) -> Cell:
    if q is None:
        return Cell("–", "muted")
    value = number(factor * q.value, 3)
    if q.low is None or q.high is None:
        return Cell(value)
    return Cell(f"{value} ({number(factor * q.low, 2)} to {number(factor * q.high, 2)})")


def handling_notes(result: Identification, verify_runs: Sequence[Recording] = ()) -> tuple[Note, ...]:
    """Warnings on runs near the critical speed or the friction limit, by the roll-yaw model if it exists."""
    found = _told(result)
    model = found.get("roll-yaw") or found.get("bicycle")
    known = model if model and model.identified else None
    return warnings(known, (*identified_runs(result), *verify_runs), result.geometry.friction)


def handling_sentence(result: Identification) -> str | None:
    """Understeer of the recommended model as a sentence, None for a model without tyres."""
    found = _told(result).get(result.recommended or "")
    return None if found is None else found.sentence


def modes_sentence(result: Identification) -> str | None:
    """Frequency and damping of the recommended model's modes; None for a model without tyres."""
    model = usable(result).get(result.recommended or "")
    if model is None:
        return None
    found = model.modes
    words = [
        f"{mode} {number(found[f'{mode}_frequency'].value, 3)} rad/s with a damping ratio of "
        f"{number(found[f'{mode}_damping'].value, 2)}"
        for mode in ("yaw", "roll")
        if f"{mode}_frequency" in found
    ]
    return f"Modes at {model.fit.speed:.2f} m/s: {', '.join(words)}." if words else None


def handling_document(result: Identification, verify_runs: Sequence[Recording] = ()) -> dict[str, Any]:
    """{models: {name: {speed_m_s, tied, identified, sentence, quantities}}, notes}.

    quantities: {<name>: {value, bound, interval [low, high] or null, unit}}.
    """
    return {
        "models": {
            name: {
                "speed_m_s": h.speed,
                "tied": h.tied,
                "identified": h.identified,
                "sentence": h.sentence,
                "quantities": {
                    n: {"value": q.value, "bound": q.bound, "interval": q.interval_90, "unit": q.unit}
                    for n, q in h.quantities.items()
                },
            }
            for name, h in result.handling.items()
        },
        "notes": [note.text for note in handling_notes(result, verify_runs)],
    }


# Sentences of the report on a result.


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
    delays = with_filters.structure.delays
    free = [e for e in with_filters.estimates if e.free and e.value and e.name not in delays]
    changes = {e.name: 100 * (without[e.name].value / e.value - 1) for e in free}
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


def prediction_sentence(result: Identification) -> str | None:
    """How the recommended model predicts the first run that is not in its fit; None without one."""
    model = result.models.get(result.recommended or "")
    if model is None or not model.verification:
        return None
    v = model.verification[0]
    return f"On {v.run} (not in the fit) J_rms {number(v.j_rms, 3)} and TIC {number(v.tic, 2)}."


def amplitude_sentence(result: Identification) -> str | None:
    """How the cornering stiffness changes from the smallest to the largest amplitude; None where little."""
    if not result.by_amplitude:
        return None
    first, last = result.by_amplitude[0], result.by_amplitude[-1]
    name = max(first.stiffness, key=lambda n: abs(last.stiffness[n] / first.stiffness[n] - 1.0))
    low, high = first.stiffness[name], last.stiffness[name]
    if abs(high / low - 1.0) < NOTABLE_BEND:
        return None
    start, end = (f"{number(one.amplitude, 3)} {unit(one.unit)}" for one in (first, last))
    change = f"from {number(low, 3)} to {number(high, 3)} N/rad between {start} and {end}"
    if high > low:
        return (
            f"{symbol(name)} rises {change}, which tyres do not: look for play or friction in the steering."
        )
    small = " The numbers above hold for small slip." if result.numbers else ""
    return f"{symbol(name)} falls {change}: the tyres bend.{small}"


def residual_sentence(result: Identification) -> str | None:
    """Whether the model of the rover's numbers leaves more than noise; None where that was not asked."""
    if not result.residual:
        return None
    parts = [f"{SHORT_NAMES.get(c, c)} {number(x**0.5, 2)}" for c, x in result.residual.items()]
    left = "noise alone" if max(result.residual.values()) <= NOTABLE else "more than noise"
    return f"The residual of the recorded motion over the noise (rms): {', '.join(parts)}; {left} is left."


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
    missing = "there is no run for verification: drive a doublet and give it with --verify"
    limits = [note.text for note in handling_notes(result, provenance.verify_runs)]
    wanted = dict.fromkeys([*repeat, *refused, *limits, *grouped_warnings(runs)])
    if not provenance.verify_runs:
        wanted[missing] = None
    said = " ".join(result.summary)
    return tuple(w for w in wanted if (w.partition(": ")[2].removeprefix("discard: ") or w) not in said)


def first_numbers(models: Mapping[str, ModelResult]) -> str:
    """The parameters of one model in one line, before the intervals are known; "" without a model."""
    name = next((n for n in ("roll-yaw", "bicycle", *models) if n in models), "")
    if not name:
        return ""
    free = [e for e in models[name].fit.estimates if e.free]
    numbers = ", ".join(f"{e.name} {e.value:.3g} {e.unit}".strip() for e in free)
    return f"first numbers, {name} model: {numbers}; intervals follow"
