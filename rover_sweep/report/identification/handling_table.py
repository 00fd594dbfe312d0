"""Handling quantities as a table, as warnings and for identification.json."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rover_sweep.data.recording import Note, Recording
from rover_sweep.identification.acceptance import TITLES, identified_runs
from rover_sweep.identification.handling import UNITS, Handling, warnings
from rover_sweep.identification.pipeline import Identification
from rover_sweep.report.identification.comparison import Cell, Table
from rover_sweep.report.wording.number_format import number, unit

LABELS = {
    "understeer_gradient": "understeer gradient K_us",
    "understeer_gradient_deg_per_g": "",
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


def handling_table(result: Identification) -> Table | None:
    """One column per model with tyres, None without any; the note has the fits with Cf and Cr free."""
    found = {name: h for name, h in result.handling.items() if name in result.models}
    if not found:
        return None
    rows = tuple(
        (Cell(LABELS[name]), Cell(unit(UNITS[name][0])), *(_cell(h, name) for h in found.values()))
        for name in UNITS
        if any(name in h.quantities for h in found.values())
    )
    headings = ("", "", *(TITLES.get(name, name) for name in found))
    note = "K_us > 0: understeer. ±: Cramér-Rao bound, from the free parameters only." + _untied(result)
    speed = next(iter(found.values())).speed
    return Table(f"Handling at {speed:.2f} m/s", headings, rows, note, 2)


def _untied(result: Identification) -> str:
    """A sentence on K_us of the fits with free Cf and Cr, "" without any."""
    others = {name: h for name, h in result.handling.items() if name not in result.models}
    if not others:
        return ""
    words = [f"{name}: {_cell(h, 'understeer_gradient_deg_per_g').text} deg/g" for name, h in others.items()]
    return f" With one C for both axles, K_us has the sign of b - a; {'; '.join(words)}."


def _cell(found: Handling, name: str) -> Cell:
    q = found.quantities.get(name)
    if q is None:
        return Cell("–", "muted")
    bound = f" ± {number(q.bound, 2)}" if q.bound is not None and q.bound > 1e-6 * abs(q.value) else ""
    return Cell(number(q.value, 3) + bound)


def handling_notes(result: Identification, verify_runs: Sequence[Recording] = ()) -> tuple[Note, ...]:
    """Warnings on runs near the critical speed or the friction limit, by the roll-yaw model if it exists."""
    found = result.handling
    model = found.get("roll-yaw") or found.get("bicycle")
    return warnings(model, (*identified_runs(result), *verify_runs), result.geometry.friction)


def handling_document(result: Identification, verify_runs: Sequence[Recording] = ()) -> dict[str, Any]:
    """{models: {name: {speed_m_s, tied, sentence, quantities: {<name>: {value, bound, unit}}}}, notes}."""
    return {
        "models": {name: _document(h) for name, h in result.handling.items()},
        "notes": [note.text for note in handling_notes(result, verify_runs)],
    }


def _document(found: Handling) -> dict[str, Any]:
    quantities = {
        n: {"value": q.value, "bound": q.bound, "unit": q.unit} for n, q in found.quantities.items()
    }
    return {
        "speed_m_s": found.speed,
        "tied": found.tied,
        "sentence": found.sentence,
        "quantities": quantities,
    }
