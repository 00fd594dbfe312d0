"""What a plan of runs is asked, and what it answers, as frozen values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from rover_sweep.diagnosis.result import Unseen

RunKind = Literal["sweep", "doublet", "bias_sweep", "multisine", "servo_test", "other"]


@dataclass(frozen=True)
class PlannedRun:
    """A run to be driven, or one that was.

    amplitude_us: peak of the steering offset [us]; speed [m/s], 0 on blocks; heading: direction of the
    drive [deg, clockwise from north], None where it does not matter; bias_us: steering offset about which
    it is driven [us]; repeat: how often; name: of a run that was driven, else "".
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
    """What may be proposed: lateral acceleration [m/s^2], peak steering offset [us], speeds [m/s].

    why: where the lateral acceleration comes from, in words.
    """

    ay: float
    amplitude_us: float
    speed: tuple[float, float]
    why: str


@dataclass(frozen=True)
class DetectableSize:
    """The size of an effect's parameter that half of such sets of runs would show; material: when it counts.

    size: None where no size would show. material: the size below which it is a nuisance and no finding.
    """

    parameter: str
    unit: str
    size: float | None
    material: float | None = None


@dataclass(frozen=True)
class Apart:
    """Two effects that look much alike in these runs: the cosine of their signatures after the refit."""

    first: str
    second: str
    cosine: float


@dataclass(frozen=True)
class Plan:
    """What a set of runs can and cannot tell.

    runs: the set asked about. detectable: {effect: size}. apart: the pairs that these runs do not tell
    apart, most alike first. cannot_see: effects that no size would show. proposal: the runs to add, the
    smallest set found; settles: a sentence for each of them; proposed_apart: what stays alike with them.
    sentences: the answer first. notes: limits that were kept, and what the sizes stand on.
    """

    runs: tuple[PlannedRun, ...]
    detectable: Mapping[str, DetectableSize] = field(default_factory=dict)
    apart: tuple[Apart, ...] = ()
    cannot_see: tuple[Unseen, ...] = ()
    proposal: tuple[PlannedRun, ...] = ()
    settles: tuple[str, ...] = ()
    proposed_apart: tuple[Apart, ...] = ()
    sentences: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
