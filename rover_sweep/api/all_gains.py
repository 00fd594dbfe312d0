"""Gains of the steering and of the speed from one folder of results."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from firmware_params.param_files import parse
from rover_sweep.api.gains import steering_gains
from rover_sweep.api.speed import speed_file, speed_gains
from rover_sweep.gains.gains_json import gains_document
from rover_sweep.gains.proposal import Proposal
from rover_sweep.gains.speed_gains_json import limits_document, speed_gains_document
from rover_sweep.gains.speed_proposal import SpeedProposal
from rover_sweep.gains.steering_limits import SteeringLimits, steering_limits
from rover_sweep.gains.write_param_file import param_text
from rover_sweep.gains.write_speed_params import limits_text, speed_text

_STEERED = ("identification.json", "diagnosis.json")


@dataclass(frozen=True, eq=False)
class AllGains:
    """What a folder of results supports: of the steering, its limits, and of the speed; None without.

    current: the vehicle's present parameters, as far as they are known.
    """

    steering: Proposal | None
    limits: SteeringLimits | None
    speed: SpeedProposal | None
    current: Mapping[str, float]

    @property
    def text(self) -> str:
        """The .param file; "" if nothing is proposed."""
        parts = []
        if self.steering is not None and self.steering.proposed is not None:
            parts.append(param_text(self.steering))
        if self.limits is not None:
            known = ("ATC_STR_RAT_MAX", "ATC_TURN_MAX_G")
            parts.append(limits_text(self.limits, {n: self.current[n] for n in known if n in self.current}))
        if self.speed is not None and self.speed.proposed is not None:
            parts.append(speed_text(self.speed))
        return "\n".join(parts)

    @property
    def unknown(self) -> tuple[str, ...]:
        """The parameters of `text` whose present value is unknown, so that the change could not be undone."""
        return tuple(p.name for p in parse(self.text) if p.name not in self.current)

    @property
    def undo(self) -> str:
        """The present values of the parameters of `text`, as a .param file."""
        lines = (f"{p.name} {self.current[p.name]:.7g}  # was to be {p.value:g}" for p in parse(self.text))
        return "\n".join(("# The values before the proposal: load this file to undo it.", "", *lines, ""))

    @property
    def document(self) -> dict[str, Any]:
        """As plain data for JSON; the keys of the steering are at the top, as without throttle sweeps."""
        top = gains_document(self.steering) if self.steering else {}
        top = {"format": "rover-sweep gains", "format_version": 1} | top
        top |= {"limits": limits_document(self.limits)} if self.limits else {}
        return top | ({"speed_loop": speed_gains_document(self.speed)} if self.speed else {})


def all_gains(
    place: Path,
    name: str | None,
    vehicle_file: str | None,
    current: Mapping[str, float],
    current_from: str,
    speed: float | None,
) -> AllGains:
    """All that a file or folder of results supports; arguments and errors as of `steering_gains`."""
    path = speed_file(place)
    loop = speed_gains(path, current, current_from) if path else None
    known = {**(loop.found.parameters if loop else {}), **current}
    alone = path is not None and not any((path.parent / each).is_file() for each in _STEERED)
    if alone or (path is not None and place == path):
        return AllGains(None, None, loop, known)
    steering = steering_gains(place, name, vehicle_file, current, current_from, speed)
    return AllGains(steering, steering_limits(steering), loop, known)
