"""A variant as the text of a TOML file, with every number in it."""

from __future__ import annotations

from dataclasses import fields

from sitl.plant.plant_law import PlantLaw
from sitl.plant.variant import PlantParameters

OTHER = ("effects", "laws")  # tables of their own


def variant_text(parameters: PlantParameters) -> str:
    """What `load_variant` reads the same parameters from."""
    numbers = ((f.name, getattr(parameters, f.name)) for f in fields(parameters) if f.name not in OTHER)
    lines = [f"{name} = {_value(value)}" for name, value in numbers]
    effects = [f"{name} = {_table(values)}" for name, values in parameters.effects.items()]
    return "\n".join([*lines, "", "[effects]", *effects, "", *map(_law, parameters.laws)])


def _law(law: PlantLaw) -> str:
    entries = (f"{f.name} = {_value(getattr(law, f.name))}" for f in fields(law))
    return "\n".join(["[[table_law]]", *entries, ""])


def _table(values: object) -> str:
    assert isinstance(values, dict)
    return "{ " + ", ".join(f"{name} = {_value(value)}" for name, value in values.items()) + " }"


def _value(value: object) -> str:
    if isinstance(value, tuple):
        return "[" + ", ".join(_value(part) for part in value) + "]"
    return f'"{value}"' if isinstance(value, str) else repr(value)
