"""One answer against its truth.

A finding is right if its effect is hidden ("first"), or if a hidden effect is among its look-alikes
("alike"); anything else is a wrong name. A finding settles one hidden effect, and a hidden effect needs one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

OUTSIDE = "outside:"

# Two names of one physics: each is right for the other.
SAME: dict[str, frozenset[str]] = {
    "transport_delay": frozenset({"servo_lag", "clock_offset"}),  # lateness of the steering
    "servo_lag": frozenset({"transport_delay"}),
}

# Names that are near the truth though the law is outside the list: counted apart, neither right nor wrong.
NEAREST: dict[str, frozenset[str]] = {
    "outside:cubic_hysteresis": frozenset(
        {"steering_nonlinearity", "steering_backlash", "steering_stiction"}
    ),
    "outside:tyre_dead_zone": frozenset({"steering_deadband"}),
    "outside:tyre_left_right": frozenset({"steering_asymmetry"}),
    "outside:resonant_linkage": frozenset({"servo_lag"}),
    "outside:slip_speed": frozenset({"tyre_speed"}),
    "outside:sliding_cargo": frozenset({"imu_offset"}),  # the CG moves away from the IMU
}

# Words of a place in the equations that are right for a law outside the list.
PLACES: dict[str, tuple[str, ...]] = {
    "outside:resonant_linkage": ("steering",),
    "outside:cubic_hysteresis": ("steering",),
    "outside:flexing_mast": ("sensor", "a_y", "ay", "roll"),
    "outside:yaw_drag": ("yaw moment",),
    "outside:tyre_left_right": ("side force",),
    "outside:sliding_cargo": ("yaw moment", "side force"),
    "outside:slosh": ("side force", "roll moment"),
    "outside:speed_steering": ("steering",),
    "outside:tyre_dead_zone": ("side force",),
    "outside:aliased_vibration": ("sensor", "a_y", "ay"),
    "outside:wheel_unbalance": ("sensor", "a_y", "ay"),
    "outside:rear_linkage": ("side force", "yaw moment"),
    "outside:pendulum": ("side force", "roll moment"),
    "outside:sliding_load": ("side force", "roll moment", "yaw moment"),
    "outside:toe_compliance": ("steering", "side force"),
    "outside:slip_speed": ("side force", "yaw moment", "speed"),
    "outside:bump_stops": ("roll moment",),
    "outside:wheel_lift": ("side force", "roll moment"),
    "outside:limping_motor": ("yaw moment",),
}


@dataclass(frozen=True)
class Graded:
    """One answer, judged. first, alike, wrong, nearest: effects; missed: hidden effects without a finding.

    placed: the unknown lies at a place of PLACES; None where nothing outside the list is hidden.
    """

    name: str
    kind: str
    hidden: tuple[str, ...]
    verdict: str
    first: tuple[str, ...]
    alike: tuple[str, ...]
    nearest: tuple[str, ...]
    wrong: tuple[str, ...]
    missed: tuple[str, ...]
    unknown: bool
    seconds: float
    placed: bool | None = None

    @property
    def named(self) -> int:
        """How many effects were named."""
        return len(self.first) + len(self.alike) + len(self.nearest) + len(self.wrong)

    @property
    def mark(self) -> str:
        """exact, look-alike, part, nearest, wrong, unknown, nothing, none (rightly), refused or failed."""
        if self.verdict in ("failed", "refused"):
            return self.verdict
        if self.wrong:
            return "wrong"
        if not self.hidden and not self.named:
            return "none"
        inside = [effect for effect in self.hidden if not effect.startswith(OUTSIDE)]
        if inside and len(self.first) == len(inside):
            return "exact"
        if inside and len(self.first) + len(self.alike) == len(inside):
            return "look-alike"
        if self.first or self.alike:
            return "part"
        if self.nearest:
            return "nearest"
        return "unknown" if self.unknown else "nothing"


def grade(
    name: str,
    kind: str,
    hidden: Sequence[str],
    answer: Mapping[str, Any],
    places: Mapping[str, tuple[str, ...]] = PLACES,
) -> Graded:
    """Marks one answer. hidden: effect ids. answer: verdict, findings, unknown, seconds.

    places: as PLACES, {effect: words}.
    """
    missing = list(hidden)
    marks: dict[str, list[str]] = {"first": [], "alike": [], "nearest": [], "wrong": []}
    for finding in _surest_first(answer["findings"], hidden):
        match, settled = _match(finding, missing)
        marks[match].append(finding["effect"])
        if settled in missing:
            missing.remove(settled)
    return Graded(
        name,
        kind,
        tuple(hidden),
        answer["verdict"],
        missed=tuple(missing),
        unknown=bool(answer.get("unknown")),
        seconds=float(answer["seconds"]),
        placed=_placed(hidden, answer.get("unknown"), places),
        **{mark: tuple(effects) for mark, effects in marks.items()},
    )


def _placed(
    hidden: Sequence[str], unknown: Mapping[str, Any] | None, places: Mapping[str, tuple[str, ...]]
) -> bool | None:
    words = [word for effect in hidden for word in places.get(effect, ())]
    if not words:
        return None
    said = unknown or {}
    text = str(said.get("place") or said.get("law") or said.get("channel") or "")
    return any(word in text for word in words)


def _surest_first(findings: Sequence[Mapping[str, Any]], hidden: Sequence[str]) -> list[Mapping[str, Any]]:
    """Findings whose own name is hidden before those that match by a look-alike."""
    return sorted(findings, key=lambda one: one["effect"] not in hidden)


def _match(finding: Mapping[str, Any], missing: Sequence[str]) -> tuple[str, str]:
    """("first", "alike", "nearest" or "wrong", the hidden effect that it settles)."""
    effect, alike = finding["effect"], finding.get("look_alikes") or []
    for one in missing:
        if effect == one or effect in SAME.get(one, ()):
            return "first", one
    for one in missing:
        if one in alike:
            return "alike", one
    for one in missing:
        if effect in NEAREST.get(one, ()):
            return "nearest", ""
    return "wrong", ""
