"""Which vehicle a link connects to, its signing key, and how the user is asked and informed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from rover_sweep.errors import UsageError
from rover_sweep.vehicle.link.signing import SigningKey


@dataclass(frozen=True)
class Heard:
    """An autopilot that is heard on a link. system: its MAVLink system id; kind: its MAV_TYPE as words."""

    system: int
    kind: str

    def __str__(self) -> str:
        return f"system {self.system} ({self.kind})"


class SeveralVehicles(UsageError):
    """More than one vehicle is heard and none was chosen. heard: all of them."""

    def __init__(self, url: str, heard: Sequence[Heard]) -> None:
        self.heard = tuple(heard)
        names = ", ".join(map(str, self.heard))
        super().__init__(f"{len(heard)} vehicles are heard on {url}: {names}; choose one with --system N")


def _nobody(sentence: str) -> None:
    """Ignore the sentence."""


@dataclass(frozen=True)
class Access:
    """system: id of the vehicle to connect to; None: the only one that is heard. choose: called for a system
    id if several are heard. tell: called with a sentence for each unexpected observation, such as a second
    rover; it may be called during any wait on the link. key: of MAVLink signing.
    """

    system: int | None = None
    choose: Callable[[Sequence[Heard]], int] | None = None
    tell: Callable[[str], None] = _nobody
    key: SigningKey | None = None

    def chosen(self, url: str, heard: Sequence[Heard]) -> int:
        """The system id to connect to, of those heard on `url`. SeveralVehicles if nobody can choose."""
        if len(heard) == 1:
            return heard[0].system
        if self.choose is None:
            raise SeveralVehicles(url, heard)
        return self.choose(heard)
