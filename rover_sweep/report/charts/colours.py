"""Colours, dashes and plain labels of the charts: Okabe and Ito's palette, distinct in print too."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

DATA, SHADE, OUTSIDE, MARK, QUIET = "#222222", "#FBE9C6", "#ECECEC", "#E69F00", "#BFE0F5"
BEFORE: dict[str, Any] = {"colour": "#0072B2", "dash": (6, 2)}
AFTER: dict[str, Any] = {"colour": "#D55E00"}
MODELS: dict[str, dict[str, Any]] = {
    "kinematic": {"colour": "#CC79A7", "dash": (2, 2), "width": 2.2},
    "bicycle": {"colour": "#0072B2", "dash": (7, 3)},
    "roll-yaw": {"colour": "#D55E00"},
    "lumped": {"colour": "#009E73", "dash": (7, 2, 2, 2)},
}
OWN = ("#56B4E9", "#8C510A", "#777777")  # for a user's own structures, in turn
CHANNEL_WORDS = {
    "pwm": "steering output, µs",
    "delta": "road-wheel angle, deg",
    "r": "yaw rate r, deg/s",
    "ay": "lateral acc. a_y, m/s²",
    "p": "roll rate p, deg/s",
    "speed": "speed V, m/s",
    "vy": "lateral velocity, m/s",
}
RESPONSE_WORDS = {
    "r": "yaw rate r",
    "ay": "lateral acceleration a_y",
    "p": "roll rate p",
    "vydot": "lateral velocity rate",
    "vy": "lateral velocity",
}


def model_colours(name: str, names: Collection[str]) -> dict[str, Any]:
    """Colour and dash of a model; a user's own structure gets one by its position in `names`."""
    if name in MODELS:
        return MODELS[name]
    place = [n for n in names if n not in MODELS].index(name)
    return {"colour": OWN[place % len(OWN)], "dash": (4, 2, 1, 2)}
