"""Which library fetches logs and parameters: pymavlink's messages on our link, or MAVSDK riding on it.

Both speak through the same link, are recorded alike and give the same bytes; `--via` chooses. Default is
"mavlink" for both, by figures measured on ArduRover 4.6.3 (SITL, real time, loop rate 100, TCP, MAVSDK
4.1): a log of 54.6 MB came at 1.21 MB/s by "mavlink" and 0.39 MB/s by "mavsdk", byte-identical, and on a
computer that was busy otherwise one of 11.6 MB at 0.45 to 0.95 and 0.06 to 0.48 MB/s; all 1298 parameters
in 0.6 s either way, but MAVSDK takes 0.4 to 0.8 s before to find the vehicle, tells no progress, and begins
an interrupted download anew. Its telemetry would have to be written down after it was decoded; here a
message is on disk before anybody looks at it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, Protocol

from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.logs.download import LogSource, MavlinkLogs
from rover_sweep.vehicle.parameters.read_write import Written, read_all, write

Via = Literal["mavlink", "mavsdk"]
DEFAULT: Via = "mavlink"


class ParameterSource(Protocol):
    """Reads and writes parameters; both raise LinkError in words."""

    def read_all(self, progress: Callable[[int, int], None] | None = None) -> dict[str, float]:
        """Every parameter, by name; progress: called with (here, of how many)."""
        ...

    def write(self, name: str, value: float) -> Written:
        """Set one where it differs, read it back and compare as float32."""
        ...


@dataclass(frozen=True)
class MavlinkParameters:
    """By PARAM_REQUEST_LIST, PARAM_SET and PARAM_REQUEST_READ."""

    link: Link

    def read_all(self, progress: Callable[[int, int], None] | None = None) -> dict[str, float]:
        return read_all(self.link, progress)

    def write(self, name: str, value: float) -> Written:
        return write(self.link, name, value)


def log_source(link: Link, via: Via = DEFAULT) -> LogSource:
    """UsageError, with mavsdk, where that library does not load; it shows at its first use."""
    if via == "mavlink":
        return MavlinkLogs(link)
    from rover_sweep.vehicle.logs.by_mavsdk import MavsdkLogs

    return MavsdkLogs(link)


def parameter_source(link: Link, via: Via = DEFAULT) -> ParameterSource:
    """As `log_source`."""
    if via == "mavlink":
        return MavlinkParameters(link)
    from rover_sweep.vehicle.parameters.by_mavsdk import MavsdkParameters

    return MavsdkParameters(link)
