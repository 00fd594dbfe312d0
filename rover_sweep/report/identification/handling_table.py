"""Handling quantities as a table, as warnings and for identification.json."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rover_sweep.data.recording import Note, Recording
from rover_sweep.identification.acceptance import TITLES, identified_runs
from rover_sweep.identification.handling import UNITS, Handling, Quantity
from rover_sweep.identification.handling_limits import warnings
from rover_sweep.identification.model_results import UNTIED
from rover_sweep.identification.pipeline import Identification
from rover_sweep.report.identification.comparison import Cell, Table
from rover_sweep.report.wording.number_format import number, unit
from rover_sweep.report.wording.shown_units import SI, ShownUnits

LABELS = {
    "understeer_gradient_deg_per_g": "understeer gradient K_us",
    "static_margin": "static margin",
    "critical_speed": "critical speed",
    "characteristic_speed": "characteristic speed",
    "yaw_rate_gain": "steady r/δ",
    "lateral_acceleration_gain": "steady a_y/δ",
    "yaw_frequency": "yaw mode, frequency",
    "yaw_damping": "yaw mode, damping",
    "roll_frequency": "roll mode, frequency",
    "roll_damping": "roll mode, damping",
}


def handling_table(result: Identification, units: ShownUnits = SI) -> Table | None:
    """One column per model with tyres, of its fit with Cf and Cr free; None without any."""
    found = _told(result)
    if not found:
        return None
    rows = tuple(
        (
            Cell(LABELS[name]),
            Cell(units.words(unit(UNITS[name][0]))),
            *(_cell(h.told.get(name), units.factor(UNITS[name][0])) for h in found.values()),
        )
        for name in LABELS
        if any(name in h.told for h in found.values())
    )
    headings = ("", "", *(TITLES.get(name, name) for name in found))
    sentences = "; ".join(f"{TITLES.get(name, name)}: {h.sentence}" for name, h in found.items())
    note = (
        f"{sentences}. From fits with Cf, Cr and a lag of the steering free. K_us > 0: understeer. "
        "Intervals: Cramér-Rao bound, and what speed lost in turns, large steering angles and 3 % of "
        "steering scale change in r/δ."
    )
    speed = next(iter(found.values())).speed
    return Table(f"Handling at {speed:.2f} m/s", headings, rows, note, 2)


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


def handling_document(result: Identification, verify_runs: Sequence[Recording] = ()) -> dict[str, Any]:
    """{models: {name: {speed_m_s, tied, identified, sentence, quantities}}, notes}.

    quantities: {<name>: {value, bound, interval [low, high] or null, unit}}.
    """
    return {
        "models": {name: _document(h) for name, h in result.handling.items()},
        "notes": [note.text for note in handling_notes(result, verify_runs)],
    }


def _document(found: Handling) -> dict[str, Any]:
    quantities = {
        n: {"value": q.value, "bound": q.bound, "interval": _interval(q), "unit": q.unit}
        for n, q in found.quantities.items()
    }
    return {
        "speed_m_s": found.speed,
        "tied": found.tied,
        "identified": found.identified,
        "sentence": found.sentence,
        "quantities": quantities,
    }


def _interval(q: Quantity) -> list[float] | None:
    return None if q.low is None or q.high is None else [q.low, q.high]
