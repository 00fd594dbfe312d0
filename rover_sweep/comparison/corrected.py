"""A corrected simulation as frozen values; `rover_sweep.twin` makes it, `rover_sweep.report` writes it."""

from __future__ import annotations

from dataclasses import dataclass, field

from rover_sweep.comparison.answer import Bode, Comparison
from rover_sweep.diagnosis.result import Overlay


@dataclass(frozen=True)
class Correction:
    """One entry of a variant file that was changed.

    entry: a number's name, or "effects.<id>". before, after: as text, "" for an effect that is not there.
    recordings: what the recordings show, with its 90 % interval, as text. reason: one sentence.
    """

    entry: str
    before: str
    after: str
    recordings: str
    reason: str


@dataclass(frozen=True, eq=False)
class TwinDrive:
    """One drive of the simulation: how it compares, and what was corrected after it.

    simulator: "plant", "embedded" or "ardurover".
    """

    comparison: Comparison
    corrections: tuple[Correction, ...] = ()
    simulator: str = "plant"


@dataclass(frozen=True, eq=False)
class Twin:
    """A simulation that was compared, corrected and driven again until it agreed or nothing helped.

    agrees: the last round agrees. corrections: of all rounds together, from the first variant to the last.
    left: sentences on what the recordings show and the simulated rover cannot have. overlays, bode: the first
    and the last simulation.
    """

    sentence: str
    agrees: bool
    rounds: tuple[TwinDrive, ...]
    corrections: tuple[Correction, ...] = ()
    left: tuple[str, ...] = ()
    overlays: tuple[Overlay, ...] = ()
    bode: tuple[Bode, ...] = ()
    remarks: tuple[str, ...] = ()
    variant: str = ""
    """Text of the corrected variant file."""
    seconds: float = field(default=0.0)
