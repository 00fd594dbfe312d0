"""The interface between a screen and a vehicle or recording: requests go in, updates come out.

A `Source` works in a thread of its own and never waits for the screen; the screen never waits for it.
There are two: a vehicle on a link (`live.vehicle`) and a recording that is played (`live.played`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

from rover_sweep.live.snapshot import Snapshot, Verdict
from rover_sweep.session.session import SessionRun
from rover_sweep.vehicle.events import Event
from rover_sweep.vehicle.link.access import Heard
from rover_sweep.vehicle.preflight.item import Check
from rover_sweep.vehicle.run.settings import RunSettings

# ---- requests of a screen -----------------------------------------------------------------------


@dataclass(frozen=True)
class Connect:
    """Open the link, find the rover. system: its MAVLink id, None: the only one that is heard."""

    url: str
    system: int | None = None


@dataclass(frozen=True)
class Preflight:
    """Run all checks before a run; changes nothing."""


@dataclass(frozen=True)
class Fix:
    """Carry out the remedy of the check `name`; reboots only if `reboot` is true."""

    name: str
    reboot: bool = False


@dataclass(frozen=True)
class DriveRequest:
    """Drive one run; nothing moves that the settings do not allow."""

    planned: SessionRun
    settings: RunSettings = field(default_factory=RunSettings)


@dataclass(frozen=True)
class FetchLogs:
    """The vehicle's logs that are new since the session began."""


@dataclass(frozen=True)
class Play:
    """A recording: rate 0 pauses, 1 is real time; at: jump to this many seconds from its start."""

    rate: float | None = None
    at: float | None = None


Request = Connect | Preflight | Fix | DriveRequest | FetchLogs | Play

# ---- updates of a source, in addition to the events of a session ----------------------------------


@dataclass(frozen=True)
class Began:
    """A request is being carried out."""

    request: Request


@dataclass(frozen=True)
class Ended:
    """A request is done; failure: a sentence, '' if it succeeded."""

    request: Request
    failure: str = ""


@dataclass(frozen=True)
class Several:
    """More than one vehicle is heard on `url`; give the system id of one to connect."""

    url: str
    heard: tuple[Heard, ...]


@dataclass(frozen=True)
class Checked:
    """The checks of a preflight, in the order in which to correct them."""

    checks: tuple[Check, ...]


@dataclass(frozen=True)
class Judged:
    """The verdict on a run, within a second of its end."""

    verdict: Verdict


@dataclass(frozen=True)
class Lost:
    """The link is lost; reason: a sentence. The source tries to reconnect until it is closed."""

    reason: str


@dataclass(frozen=True)
class Played:
    """Position in a recording: `t` of `length` [s], at `rate` times real time."""

    t: float
    length: float
    rate: float


Update = Event | Snapshot | Began | Ended | Several | Checked | Judged | Lost | Played


class Source(Protocol):
    """A vehicle, or a recording."""

    def start(self, tell: Callable[[Update], None]) -> None:
        """Begin to work; `tell` is called in the source's own thread and must return at once."""
        ...

    def ask(self, request: Request) -> None:
        """Queue a request; returns at once."""
        ...

    def abort(self) -> None:
        """At once, before all queued requests: end the present run and release the rover."""
        ...

    def close(self) -> None:
        """End the present run as `abort` does, close the link, end the thread."""
        ...
