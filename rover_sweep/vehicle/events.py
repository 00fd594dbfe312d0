"""What happens in a session, as values: a display shows them, tests compare them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from rover_sweep.manoeuvre.sweep import Manoeuvre
from rover_sweep.vehicle.identity import VehicleIdentity
from rover_sweep.vehicle.link.streams import Stream, StreamQuality


@dataclass(frozen=True)
class Connected:
    """A rover with the applet answers on `url`."""

    url: str
    vehicle: VehicleIdentity


@dataclass(frozen=True)
class ParameterSet:
    """A parameter was changed, read back and found right."""

    name: str
    old: float | None
    value: float
    reboot: bool = False


@dataclass(frozen=True)
class Rebooting:
    """The rover was told to reboot, because of these parameters (or the applet)."""

    because: tuple[str, ...]


@dataclass(frozen=True)
class StreamsSet:
    """The rates that the rover grants."""

    streams: tuple[Stream, ...]


@dataclass(frozen=True)
class Notice:
    """Something to tell the user. level 'warning' where it may spoil the result."""

    level: Literal["info", "warning"]
    text: str


@dataclass(frozen=True)
class Said:
    """A status text of the vehicle; t [s] on its clock, severity MAV_SEVERITY."""

    t: float
    severity: int
    text: str


@dataclass(frozen=True)
class RunStarted:
    """The sweep parameters of this run are on the vehicle."""

    name: str
    manoeuvre: Manoeuvre
    tlog: Path


@dataclass(frozen=True)
class Armed:
    """The rover is armed (by us, on the user's word)."""

    t: float


@dataclass(frozen=True)
class SwitchWanted:
    """The pilot is asked to throw the switch."""

    position: Literal["high", "low"]
    channel: int


@dataclass(frozen=True)
class StateChanged:
    """The applet entered a state (firmware_params.applet_parameters.STATES); t [s] on the vehicle's clock."""

    t: float
    state: int
    name: str


@dataclass(frozen=True)
class Sample:
    """For a live display, thinned out. ISO axes: r [rad/s] and ay [m/s^2] are positive to the left.

    t: vehicle clock [s]; pwm: steering output [us]; speed [m/s]; frequency of the sweep now [rad/s].
    """

    t: float
    state: int
    pwm: float
    r: float
    ay: float
    speed: float
    frequency: float


@dataclass(frozen=True)
class RunFinished:
    """A run is over and its recording complete.

    completed: the manoeuvre ran to its end; reason: in words. span: (start, end) s on the vehicle's
    clock, from the switch to the last state. number: the applet's run counter (SWP_RUN).
    """

    name: str
    completed: bool
    reason: str
    tlog: Path
    span: tuple[float, float]
    number: int
    quality: tuple[StreamQuality, ...]


@dataclass(frozen=True)
class Interrupted:
    """Ctrl-C ended run `name`; the session goes on to fetch the logs.

    failures: what could not be let go, in words, empty where all was. armed: whether the rover still is.
    """

    name: str
    tlog: Path
    failures: tuple[str, ...]
    armed: bool


@dataclass(frozen=True)
class LogProgress:
    """Bytes of log `number` that are here."""

    number: int
    done: int
    total: int


@dataclass(frozen=True)
class LogSaved:
    """A log of the vehicle is on disk; seconds it took."""

    path: Path
    size: int
    seconds: float


@dataclass(frozen=True)
class SessionFinished:
    """All runs are done; `folder` holds tlogs, logs and session.json. runs: those that came to an end."""

    folder: Path
    runs: tuple[RunFinished, ...]
    logs: tuple[Path, ...]


Event = (
    Connected
    | ParameterSet
    | Rebooting
    | StreamsSet
    | Notice
    | Said
    | RunStarted
    | Armed
    | SwitchWanted
    | StateChanged
    | Sample
    | RunFinished
    | Interrupted
    | LogProgress
    | LogSaved
    | SessionFinished
)
