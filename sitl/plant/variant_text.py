"""A variant as the text of a TOML file, with every number in it."""

from __future__ import annotations

from dataclasses import fields

from sitl.plant.plant_law import PlantLaw
from sitl.plant.variant import PlantParameters

OTHER = ("effects", "laws")  # tables of their own


def variant_text(parameters: PlantParameters) -> str:
    """What `load_variant` reads the same parameters from."""
    numbers = ((f.name, getattr(parameters, f.name)) for f in fields(parameters) if f.name not in OTHER)
    lines = [f"{name} = {value_text(value)}" for name, value in numbers]
    effects = [f"{name} = {_table(values)}" for name, values in parameters.effects.items()]
    return "\n".join([*lines, "", "[effects]", *effects, "", *map(law_text, parameters.laws)])


def law_text(law: PlantLaw) -> str:
    """One table [[table_law]]."""
    entries = (f"{f.name} = {value_text(getattr(law, f.name))}" for f in fields(law))
    return "\n".join(["[[table_law]]", *entries, ""])


def _table(values: object) -> str:
    assert isinstance(values, dict)
    return "{ " + ", ".join(f"{name} = {value_text(value)}" for name, value in values.items()) + " }"


def value_text(value: object) -> str:
    """A number, text or triple as TOML."""
    if isinstance(value, tuple):
        return "[" + ", ".join(value_text(part) for part in value) + "]"
    return f'"{value}"' if isinstance(value, str) else repr(value)
