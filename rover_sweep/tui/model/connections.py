"""The connections to choose from: command line, used before, plugged in, usual."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rover_sweep.vehicle.link.access import Heard

USUAL = ("udp:0.0.0.0:14550", "tcp:127.0.0.1:5760")


@dataclass(frozen=True)
class ConnectionChoice:
    """A connection to choose, and its origin. system: one of several vehicles on it."""

    url: str
    origin: str
    system: int | None = None


def places(given: str, remembered: tuple[str, ...], ports: tuple[str, ...]) -> tuple[ConnectionChoice, ...]:
    """Each connection once, the most likely first."""
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
    """The list with `url` replaced by an entry per vehicle heard on it, at the front if it was not listed."""
    each = tuple(ConnectionChoice(url, str(one), one.system) for one in heard)
    at = next((n for n, place in enumerate(found) if place.url == url), 0)
    rest = [place for place in found if place.url != url]
    return (*rest[:at], *each, *rest[at:])
