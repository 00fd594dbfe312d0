"""How a link gets at its vehicle: what its user says beforehand, and where the user is asked and told."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from rover_sweep.errors import UsageError
from rover_sweep.vehicle.link.signing import SigningKey


@dataclass(frozen=True)
class Heard:
    """An autopilot that is heard on a link. system: its MAVLink system id; kind: of vehicle, in words."""

    system: int
    kind: str

    def __str__(self) -> str:
        return f"system {self.system} ({self.kind})"


class SeveralVehicles(UsageError):
    """More than one is heard and nobody says which is meant. heard: all of them."""

    def __init__(self, url: str, heard: Sequence[Heard]) -> None:
        self.heard = tuple(heard)
        names = ", ".join(map(str, self.heard))
        super().__init__(f"{len(heard)} vehicles are heard on {url}: {names}; choose one with --system N")


def _nobody(sentence: str) -> None:
    """Nobody is told."""


@dataclass(frozen=True)
class Access:
    """system: id of the only vehicle that is listened to; None where the one that is heard is meant. choose:
    is asked for a system id where several are heard. tell: is given a sentence for each thing that a link
    notices beside its vehicle, such as a second rover; it may be called wherever somebody waits on the link.
    key: of MAVLink signing.
    """

    system: int | None = None
    choose: Callable[[Sequence[Heard]], int] | None = None
    tell: Callable[[str], None] = _nobody
    key: SigningKey | None = None

    def chosen(self, url: str, heard: Sequence[Heard]) -> int:
        """The system id that is meant of those heard on `url`. SeveralVehicles where nobody can say."""
        if len(heard) == 1:
            return heard[0].system
        if self.choose is None:
            raise SeveralVehicles(url, heard)
        return self.choose(heard)
