"""The connections that can be chosen: of the command line, used before, plugged in, usual."""

from __future__ import annotations

from dataclasses import dataclass

USUAL = ("udp:127.0.0.1:14550", "tcp:127.0.0.1:5760")


@dataclass(frozen=True)
class Place:
    """A connection that can be chosen, and where it comes from."""

    url: str
    origin: str


def places(given: str, remembered: tuple[str, ...], ports: tuple[str, ...]) -> tuple[Place, ...]:
    """Each once, the likeliest first."""
    found: dict[str, str] = {}
    for urls, origin in (
        ((given,) if given else (), "command line"), (remembered, "used before"),
        (ports, "plugged in"), (USUAL, "usual"),
    ):  # fmt: skip
        for url in urls:
            found.setdefault(url, origin)
    return tuple(Place(url, origin) for url, origin in found.items())
