"""The library of left-out effects, one file each; a new file with an `EFFECT` needs no registration."""

from __future__ import annotations

from functools import cache
from importlib import import_module
from pkgutil import iter_modules

from rover_sweep.diagnosis.effects.effect import Effect, EffectParameter

__all__ = ["Effect", "EffectParameter", "library"]


@cache
def library() -> dict[str, Effect]:
    """{id: effect} of every module of this package that defines `EFFECT`, sorted by id."""
    modules = [import_module(f"{__name__}.{m.name}") for m in iter_modules(__path__)]
    found = [m.EFFECT for m in modules if hasattr(m, "EFFECT")]
    return {e.id: e for e in sorted(found, key=lambda e: e.id)}
