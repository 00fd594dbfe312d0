"""The question to a plan of runs and its answer, as frozen values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from rover_sweep.diagnosis.result import Unseen

RunKind = Literal["sweep", "doublet", "bias_sweep", "multisine", "servo_test", "other"]


@dataclass(frozen=True)
class PlannedRun:
    """A run to drive, or one that was driven.

    amplitude_us: peak steering offset [us]. speed [m/s], 0 on blocks. heading: direction of the drive [deg
    clockwise from north], None if any. bias_us: steering offset about which the run is driven [us].
    repeat: number of drives. name: of a run that was driven, else "".
    """

    kind: RunKind
    amplitude_us: float
    speed: float
    heading: float | None = None
    bias_us: float = 0.0
    repeat: int = 1
    name: str = ""


@dataclass(frozen=True)
class Limits:
    """Limits of proposed runs: lateral acceleration [m/s^2], peak steering offset [us], speeds [m/s].

    why: the origin of the lateral acceleration, for a sentence.
    """

    ay: float
    amplitude_us: float
    speed: tuple[float, float]
    why: str


@dataclass(frozen=True)
class DetectableSize:
    """The size of an effect's parameter from which a diagnosis is expected to name the effect.

    size: None if no size is detectable. material: the size that matters; smaller is normal tolerance.
    """

    parameter: str
    unit: str
    size: float | None
    material: float | None = None


@dataclass(frozen=True)
class SimilarPair:
    """An effect that is not separated; expected probability of the second one where the first is true."""

    first: str
    second: str
    probability: float


@dataclass(frozen=True)
class Plan:
    """What a set of runs can detect and separate, and the runs to add.

    runs: the given set. detectable: {effect: size}. look_alikes: the pairs that these runs do not separate,
    largest probability first. cannot_see: effects that are not detectable at any size. proposal: the runs to
    add; settles: a sentence for each of them; proposed_look_alikes: the pairs that remain with them.
    sentences: the answer first. notes: limits that were kept.
    """

    runs: tuple[PlannedRun, ...]
    detectable: Mapping[str, DetectableSize] = field(default_factory=dict)
    look_alikes: tuple[SimilarPair, ...] = ()
    cannot_see: tuple[Unseen, ...] = ()
    proposal: tuple[PlannedRun, ...] = ()
    settles: tuple[str, ...] = ()
    proposed_look_alikes: tuple[SimilarPair, ...] = ()
    sentences: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
