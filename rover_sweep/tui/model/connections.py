"""The connections that can be chosen: of the command line, used before, plugged in, usual."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rover_sweep.vehicle.link.access import Heard

USUAL = ("udp:127.0.0.1:14550", "tcp:127.0.0.1:5760")


@dataclass(frozen=True)
class ConnectionChoice:
    """A connection that can be chosen, and where it comes from."""

    url: str
    origin: str
    system: int | None = None  # of several vehicles there


def places(given: str, remembered: tuple[str, ...], ports: tuple[str, ...]) -> tuple[ConnectionChoice, ...]:
    """Each once, the likeliest first."""
    found: dict[str, str] = {}
    for urls, origin in (
        ((given,) if given else (), "command line"),
        (remembered, "used before"),
        (ports, "plugged in"),
        (USUAL, "usual"),
    ):
        for url in urls:
            found.setdefault(url, origin)
    return tuple(ConnectionChoice(url, origin) for url, origin in found.items())


def with_systems(
    found: tuple[ConnectionChoice, ...], url: str, heard: Sequence[Heard]
) -> tuple[ConnectionChoice, ...]:
    """Each vehicle that is heard on `url`, in its place; at the front where it is not among those found."""
    each = tuple(ConnectionChoice(url, str(one), one.system) for one in heard)
    at = next((n for n, place in enumerate(found) if place.url == url), 0)
    rest = [place for place in found if place.url != url]
    return (*rest[:at], *each, *rest[at:])
