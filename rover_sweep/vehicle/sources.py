"""Which library fetches logs and parameters (`--via`): pymavlink, or MAVSDK, both through our link.

Both are recorded in the same way and give the same bytes. The default is "mavlink", because it is faster.
Measured on ArduRover 4.6.3 (SITL, real time, loop rate 100, TCP, MAVSDK 4.1): a log of 54.6 MB came at
1.21 MB/s by "mavlink" and 0.39 MB/s by "mavsdk", byte-identical; on a busy computer a log of 11.6 MB at
0.45 to 0.95 and 0.06 to 0.48 MB/s. Both read all 1298 parameters in 0.6 s, but MAVSDK needs another 0.4 to
0.8 s to find the vehicle, reports no progress, and restarts an interrupted download from the beginning.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, Protocol

from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.logs.download import LogSource, MavlinkLogs
from rover_sweep.vehicle.parameters.read_write import Written, read_all, write_parameter

Via = Literal["mavlink", "mavsdk"]
DEFAULT: Via = "mavlink"


class ParameterSource(Protocol):
    """Reads and writes parameters; both may raise LinkError."""

    def read_all(self, progress: Callable[[int, int], None] | None = None) -> dict[str, float]:
        """Every parameter, by name; progress: called with (number received, total)."""
        ...

    def write(self, name: str, value: float) -> Written:
        """Set a parameter if it differs, read it back and compare as float32."""
        ...


@dataclass(frozen=True)
class MavlinkParameters:
    """By PARAM_REQUEST_LIST, PARAM_SET and PARAM_REQUEST_READ."""

    link: Link

    def read_all(self, progress: Callable[[int, int], None] | None = None) -> dict[str, float]:
        return read_all(self.link, progress)

    def write(self, name: str, value: float) -> Written:
        return write_parameter(self.link, name, value)


def log_source(link: Link, via: Via = DEFAULT) -> LogSource:
    """The source of logs. With "mavsdk", the first use raises UsageError if that library does not load."""
    if via == "mavlink":
        return MavlinkLogs(link)
    from rover_sweep.vehicle.logs.by_mavsdk import MavsdkLogs

    return MavsdkLogs(link)


def parameter_source(link: Link, via: Via = DEFAULT) -> ParameterSource:
    """The source of parameters; errors as in `log_source`."""
    if via == "mavlink":
        return MavlinkParameters(link)
    from rover_sweep.vehicle.parameters.by_mavsdk import MavsdkParameters

    return MavsdkParameters(link)
