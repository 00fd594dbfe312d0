"""The library of left-out effects, one file each; a new file with an `EFFECT` needs no registration.

A file may have `FORMS` too: other laws of the same effect.
"""

from __future__ import annotations

from functools import cache
from importlib import import_module
from pkgutil import iter_modules
from types import ModuleType

from rover_sweep.diagnosis.effects.effect import Effect, EffectParameter

__all__ = ["Effect", "EffectParameter", "every_form", "form_named", "forms_of", "library"]


@cache
def _modules() -> tuple[ModuleType, ...]:
    found = (import_module(f"{__name__}.{m.name}") for m in iter_modules(__path__))
    return tuple(m for m in found if hasattr(m, "EFFECT"))


@cache
def library() -> dict[str, Effect]:
    """{id: effect} of every module of this package that defines `EFFECT`, sorted by id."""
    return {e.id: e for e in sorted((m.EFFECT for m in _modules()), key=lambda e: e.id)}


@cache
def every_form() -> dict[str, Effect]:
    """{name: law} of all effects and all their forms."""
    further = {f.name: f for m in _modules() for f in getattr(m, "FORMS", ())}
    return library() | further


def form_named(name: str) -> Effect:
    """The law of a name: an id, or "<id>/<form>"; KeyError where there is none."""
    return every_form()[name]


def forms_of(effect: str) -> tuple[Effect, ...]:
    """All laws of the effect with this id, that of `EFFECT` first."""
    return (library()[effect], *(f for f in every_form().values() if f.id == effect and not f.first))
