"""The parts of a model that is simulated, apart from the values of its coordinates."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeVar

from rover_sweep.data.geometry import Geometry
from rover_sweep.diagnosis.effects.effect import Effect

Kind = TypeVar("Kind", bound=Effect)


@dataclass(frozen=True)
class Structure:
    """The parts of a model: the rover's numbers, slip, roll, and effects.

    slip, roll: True if the tyres slip, the body rolls. happened_in: name of the run with a change of ground,
    "" for every run; happened_order: its place in the order of driving. lumped: derivatives replace
    tyres and springs.
    """

    rover: Geometry
    slip: bool
    roll: bool
    effects: tuple[Effect, ...] = ()
    happened_in: str = ""
    lumped: bool = False
    happened_order: int = 0

    def of(self, kind: type[Kind]) -> tuple[Kind, ...]:
        """The effects of a kind."""
        return tuple(e for e in self.effects if isinstance(e, kind))


Values = Mapping[str, float]
