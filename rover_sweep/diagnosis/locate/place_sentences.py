"""Parts of the sentences on places."""

from __future__ import annotations

import numpy as np

CHANNEL_NAMES = {"r": "r", "ay": "a_y", "p": "p", "vy": "V_y"}
WINDS = ("north", "north-west", "west", "south-west", "south", "south-east", "east", "north-east")


def channel_name(channel: str) -> str:
    """A channel's name in a sentence."""
    return CHANNEL_NAMES.get(channel, channel)


def band_text(band: tuple[float, float]) -> str:
    """A band of frequencies."""
    return f"between {band[0]:.3g} and {band[1]:.3g} rad/s"


def noise_ratio(ratio: float) -> str:
    """A size in multiples of the noise."""
    return f"{ratio:.0f} times the noise" if ratio >= 10 else f"{ratio:.1f} times the noise"


def ordinal(k: int) -> str:
    """1st, 2nd, 3rd, 4th ..."""
    return str(k) + {1: "st", 2: "nd", 3: "rd"}.get(k, "th")


def compass_point(psi: float) -> str:
    """The compass point of a heading [rad], left positive from north."""
    return WINDS[int(np.round(psi / (np.pi / 4))) % 8]
