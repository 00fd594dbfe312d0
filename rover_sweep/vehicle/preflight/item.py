"""The result of one check before a run: the observed value and, if there is one, a remedy."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

State = Literal["good", "doubtful", "bad", "unknown"]


@dataclass(frozen=True)
class Remedy:
    """words: what it does. reboot: it needs a reboot afterwards. by_hand: only a person can do it. sets: the
    parameters that it sets, (name, value)."""

    words: str
    reboot: bool = False
    by_hand: bool = False
    sets: tuple[tuple[str, float], ...] = ()


@dataclass(frozen=True)
class Check:
    """The result of a check. name: stable, lower case (link, firmware, applet, parameters, filters,
    loop_rate, ekf, gps, battery, rc, switch, disk, streams, source, mode); seen: the observed value in a few
    words; sentence: what it means."""

    name: str
    state: State
    seen: str
    sentence: str = ""
    remedy: Remedy | None = None
