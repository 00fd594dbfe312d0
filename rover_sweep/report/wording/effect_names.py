"""Names of effects and channels in texts; the ids are for programs."""

from __future__ import annotations

import re

from rover_sweep.diagnosis.effects import library
from rover_sweep.report.wording.number_format import SHORT_NAMES

CHANNELS = {**SHORT_NAMES, "vy": "V_y"}
LONG_CHANNELS = {
    "r": "yaw rate r, deg/s",
    "ay": "lateral acc. $a_y$, m/s²",
    "p": "roll rate p, deg/s",
    "vy": "lateral velocity $V_y$, m/s",
}


def title(effect: str) -> str:
    """The effect's name in words, from its id if unknown."""
    known = library().get(effect)
    return known.title if known else effect.replace("_", " ")


def channel(name: str) -> str:
    """A response as it is written in tables."""
    return CHANNELS.get(name, name)


def capital(text: str) -> str:
    """The text with a capital first letter, unless it starts with a name such as a_y, r or run1."""
    return text[:1].upper() + text[1:] if re.match(r"(a |[a-z]{2,}\b(?![_\d]))", text) else text


def sentence(text: str) -> str:
    """The text with a capital letter and a full stop."""
    text = capital(text.strip())
    return text if not text or text[-1] in ".!?" else f"{text}."
