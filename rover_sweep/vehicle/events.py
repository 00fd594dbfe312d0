"""The events of a session, as values: a display shows them, tests compare them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from rover_sweep.manoeuvre.sweep import Manoeuvre
from rover_sweep.vehicle.identity import VehicleIdentity
from rover_sweep.vehicle.link.statustext import Said as Said
from rover_sweep.vehicle.link.streams import Stream, StreamQuality
from rover_sweep.vehicle.parameters import ParameterSet as ParameterSet

UNCONFIRMED = (
    "the rover did not confirm that it was released: keep away from its wheels until the transmitter steers "
    "and drives it"
)


@dataclass(frozen=True)
class Connected:
    """A rover answers on `url`."""

    url: str
    vehicle: VehicleIdentity


@dataclass(frozen=True)
class Rebooting:
    """The rover is rebooting, because of these parameters (or the applet)."""

    because: tuple[str, ...]


@dataclass(frozen=True)
class StreamsSet:
    """The rates that the rover grants."""

    streams: tuple[Stream, ...]


@dataclass(frozen=True)
class Notice:
    """A sentence for the user. level: 'warning' if it may spoil the result."""

    level: Literal["info", "warning"]
    text: str


@dataclass(frozen=True)
class RunStarted:
    """The sweep parameters of this run are set on the vehicle."""

    name: str
    manoeuvre: Manoeuvre
    tlog: Path


@dataclass(frozen=True)
class Armed:
    """The rover is armed, by the pilot or with the user's consent by us; t [s] on the vehicle's clock."""

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
    """Values for a live display, about ten a second. ISO axes: r and ay are positive to the left.

    t: vehicle clock [s]; state: of the applet; pwm: steering output [us]; r: yaw rate [rad/s]; ay: lateral
    acceleration [m/s^2]; speed [m/s]; frequency: present frequency of the sweep [rad/s].
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

    completed: the manoeuvre ran to its end; reason: why it ended, for the user. span: (start, end) on the
    vehicle's clock [s], from the switch to the last state. number: the applet's run counter (SWP_RUN).
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
    """Ctrl-C ended run `name`; the session continues with fetching the logs.

    failures: sentences on what could not be released. armed: whether the rover is, as far as it was heard.
    confirmed: after the release the rover reported that its applet does not steer.
    """

    name: str
    tlog: Path
    failures: tuple[str, ...]
    armed: bool
    confirmed: bool

    @property
    def unreleased(self) -> str:
        """What is not known to be released, in words; '' if all is."""
        return "; ".join(self.failures) or ("" if self.confirmed else UNCONFIRMED)


@dataclass(frozen=True)
class LogProgress:
    """`done` of `total` bytes of log `number` are downloaded."""

    number: int
    done: int
    total: int


@dataclass(frozen=True)
class LogSaved:
    """A log of the vehicle is on disk. size [bytes]; seconds: duration of the download."""

    path: Path
    size: int
    seconds: float


@dataclass(frozen=True)
class SessionFinished:
    """The session is over; `folder` holds tlogs, logs and session.json. runs: those not interrupted."""

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
