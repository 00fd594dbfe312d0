"""The settings of a diagnosis."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from rover_sweep.data.tolerances import Tolerances

Baseline = Literal["roll-yaw", "bicycle", "lumped", "kinematic"]
BASELINES: tuple[Baseline, ...] = ("roll-yaw", "bicycle", "lumped", "kinematic")

START = ("Izz", "k_phi", "b_phi", "C", "Cf", "Cr")  # parameters of a model that the fit begins from, above 0


@dataclass(frozen=True)
class DiagnosisSettings:
    """Settings. baseline: the model to test, None for the most complete one that the runs determine.

    with_effects: the only candidates, empty for all; without_effects: ids to exclude. time_limit [s]: the
    diagnosis ends with the results so far, None for no limit. seed: of the bootstrap. parameters: {name: SI
    value} of an identified model as start values, empty to find them from the runs. spread: normal
    tolerances of a rover against its vehicle file.
    """

    baseline: Baseline | None = None
    with_effects: tuple[str, ...] = ()
    without_effects: tuple[str, ...] = ()
    time_limit: float | None = None
    seed: int = 1
    parameters: Mapping[str, float] = field(default_factory=dict)
    spread: Tolerances = Tolerances()

    def candidates(self, known: tuple[str, ...]) -> tuple[str, ...]:
        """The ids of the known effects that these settings select, in their order."""
        chosen = self.with_effects or known
        return tuple(e for e in known if e in chosen and e not in self.without_effects)
