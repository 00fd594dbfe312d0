"""The one interface between a screen and what it shows: requests go in, events come out.

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

# ---- what a screen asks -------------------------------------------------------------------------


@dataclass(frozen=True)
class Connect:
    """Open the link, find the rover. system: its MAVLink id, None where the one that is heard is meant."""

    url: str
    system: int | None = None


@dataclass(frozen=True)
class Preflight:
    """Read everything that must be right before a run; changes nothing."""


@dataclass(frozen=True)
class Fix:
    """Do what the check `name` offers as its remedy; reboots only where `reboot` is true."""

    name: str
    reboot: bool = False


@dataclass(frozen=True)
class DriveRequest:
    """One run, with what the settings allow. Nothing moves that they do not name."""

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

# ---- what a source tells beside the events of a session -----------------------------------------


@dataclass(frozen=True)
class Began:
    """A request is being carried out."""

    request: Request


@dataclass(frozen=True)
class Ended:
    """A request is done; failure: in words, '' where it went well."""

    request: Request
    failure: str = ""


@dataclass(frozen=True)
class Several:
    """More than one vehicle is heard on `url`; connecting there needs the system id of one."""

    url: str
    heard: tuple[Heard, ...]


@dataclass(frozen=True)
class Checked:
    """What a preflight found, in the order in which it is to be put right."""

    checks: tuple[Check, ...]


@dataclass(frozen=True)
class Judged:
    """The verdict on a run, within a second of its end."""

    verdict: Verdict


@dataclass(frozen=True)
class Lost:
    """The link is gone, in words; the source tries to get it back until it is closed."""

    reason: str


@dataclass(frozen=True)
class Played:
    """Where a recording stands: t of length s, at `rate` times real time."""

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
        """Carried out in turn; returns at once."""
        ...

    def abort(self) -> None:
        """Ahead of everything that was asked: the run under way is ended, the rover is let go."""
        ...

    def close(self) -> None:
        """End the run under way as `abort` does, close the link, end the thread."""
        ...
