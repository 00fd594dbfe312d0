"""How the places of a mismatch are put into words."""

from __future__ import annotations

import numpy as np

CALLED = {"r": "r", "ay": "a_y", "p": "p", "vy": "V_y"}
WINDS = ("north", "north-west", "west", "south-west", "south", "south-east", "east", "north-east")


def called(channel: str) -> str:
    """A channel as it is written in a sentence."""
    return CALLED.get(channel, channel)


def between(band: tuple[float, float]) -> str:
    """A band of frequencies."""
    return f"between {band[0]:.3g} and {band[1]:.3g} rad/s"


def times(ratio: float) -> str:
    """A size in noise floors."""
    return f"{ratio:.0f} times the noise" if ratio >= 10 else f"{ratio:.1f} times the noise"


def ordinal(k: int) -> str:
    """1st, 2nd, 3rd, 4th ..."""
    return str(k) + {1: "st", 2: "nd", 3: "rd"}.get(k, "th")


def wind(psi: float) -> str:
    """The compass point of a heading [rad], left positive from north."""
    return WINDS[int(np.round(psi / (np.pi / 4))) % 8]
