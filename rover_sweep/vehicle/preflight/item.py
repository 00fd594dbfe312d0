"""What must be right before a run, each with what was seen and a remedy where there is one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

State = Literal["good", "doubtful", "bad", "unknown"]


@dataclass(frozen=True)
class Remedy:
    """What one key does. reboot: the rover has to boot anew afterwards. by_hand: only a person can.
    sets: the parameters that it sets, (name, value)."""

    words: str
    reboot: bool = False
    by_hand: bool = False
    sets: tuple[tuple[str, float], ...] = ()


@dataclass(frozen=True)
class Check:
    """One thing that was looked at. name: stable, lower case (link, firmware, applet, parameters, filters,
    loop_rate, ekf, gps, battery, rc, switch, disk, streams, source, mode); seen: the value in a few words."""

    name: str
    state: State
    seen: str
    sentence: str = ""
    remedy: Remedy | None = None
