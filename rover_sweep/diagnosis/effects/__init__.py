"""The library of left-out effects; each module of this package lists its own in `LAWS`."""

from __future__ import annotations

from functools import cache

from rover_sweep.diagnosis.effects import chassis, sensors, steering
from rover_sweep.diagnosis.effects.effect import Effect, EffectParameter

__all__ = ["Effect", "EffectParameter", "every_form", "form_named", "forms_of", "library"]


@cache
def every_form() -> dict[str, Effect]:
    """{name: law} of all effects and all their forms, sorted by id."""
    laws = (*steering.LAWS, *chassis.LAWS, *chassis.SURROUNDINGS, *sensors.LAWS)
    return {law.name: law for law in sorted(laws, key=lambda law: law.id)}


@cache
def library() -> dict[str, Effect]:
    """{id: effect}, the first law of each, sorted by id."""
    return {name: law for name, law in every_form().items() if law.first}


def form_named(name: str) -> Effect:
    """The law with this name, "<id>" or "<id>/<form>"; else KeyError."""
    return every_form()[name]


def forms_of(effect: str) -> tuple[Effect, ...]:
    """All laws of the effect with this id, the first one first."""
    return tuple(law for law in every_form().values() if law.id == effect)
