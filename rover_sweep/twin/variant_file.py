"""The corrected rover as a variant file: every line with its reason."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields

from rover_sweep.comparison.corrected import Correction
from sitl.plant.variant import PlantParameters, load_variant
from sitl.plant.variant_text import law_text, value_text

TABLES = ("effects", "laws")


def variant_with_reasons(rover: PlantParameters, corrections: Sequence[Correction], origin: str) -> str:
    """The variant as TOML text. origin: what the rover was before the corrections, in words."""
    nominal = load_variant("nominal")
    reasons = {c.entry: c for c in corrections}
    lines = [
        f"# The simulated rover {origin}, corrected by rover-sweep until it agreed with recordings.",
        "# Numbers that are not here are those of the nominal rover.",
        'base = "nominal"',
        "",
    ]
    for f in fields(rover):
        value = getattr(rover, f.name)
        if f.name not in TABLES and value != getattr(nominal, f.name):
            lines += [*_reason(reasons.get(f.name)), f"{f.name} = {value_text(_rounded(value))}"]
    lines += ["", "[effects]"]
    for name, entry in rover.effects.items():
        values = ", ".join(f"{p} = {value_text(_rounded(v))}" for p, v in entry.items())
        lines += [*_reason(reasons.get(f"effects.{name}")), f"{name} = {{ {values} }}"]
    return "\n".join([*lines, "", *(law_text(law) for law in rover.laws)])


def _reason(c: Correction | None) -> list[str]:
    if c is None:
        return []
    return [f"# was {c.before or 'not there'}: {' '.join(c.reason.split())}"]


def _rounded(value: object) -> object:
    if isinstance(value, tuple):
        return tuple(_rounded(part) for part in value)
    return float(f"{value:.7g}") if isinstance(value, float) else value
