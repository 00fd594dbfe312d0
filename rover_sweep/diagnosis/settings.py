"""What a user may choose of a diagnosis."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from rover_sweep.data.tolerances import Tolerances

Baseline = Literal["roll-yaw", "bicycle", "lumped", "kinematic"]
BASELINES: tuple[Baseline, ...] = ("roll-yaw", "bicycle", "lumped", "kinematic")


@dataclass(frozen=True)
class DiagnosisSettings:
    """baseline: the model that something may have been left out of.

    with_effects: the only candidates, empty for all; without_effects: those left out. time_limit [s]:
    the diagnosis ends with what it has, None for no limit. seed: of the bootstrap. parameters: {name: SI
    value} of a model that was identified before, to begin from; empty: found from the runs. spread: how far
    an ordinary rover lies from its vehicle file.
    """

    baseline: Baseline = "roll-yaw"
    with_effects: tuple[str, ...] = ()
    without_effects: tuple[str, ...] = ()
    time_limit: float | None = None
    seed: int = 1
    parameters: Mapping[str, float] = field(default_factory=dict)
    spread: Tolerances = Tolerances()

    def candidates(self, known: tuple[str, ...]) -> tuple[str, ...]:
        """Those of the known effects that are asked for, in their order."""
        chosen = self.with_effects or known
        return tuple(e for e in known if e in chosen and e not in self.without_effects)
