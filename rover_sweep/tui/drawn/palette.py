"""Two sets of colours; every text has a WCAG 2.1 contrast of 7 or more to its ground (1.4.6, AAA).

Black on white for the sun, white on black for dusk. Colour is never the only sign: there
is always a word too (`labels.py`).
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Palette:
    """Colours as #rrggbb. alarm: (text, background) of the ABORT bar and of alarms."""

    name: str
    ink: str
    ground: str
    quiet: str
    good: str
    doubtful: str
    bad: str
    accent: str
    alarm: tuple[str, str]

    @property
    def inverse(self) -> str:
        """Style of the chosen row."""
        return f"bold {self.ground} on {self.ink}"

    @property
    def alarming(self) -> str:
        return f"bold {self.alarm[0]} on {self.alarm[1]}"

    @property
    def asking(self) -> str:
        """Style of a request to the pilot."""
        return f"bold {self.ground} on {self.accent}"


LIGHT = Palette(
    "light",
    "#000000",
    "#ffffff",
    "#404040",
    "#005000",
    "#5c3a00",
    "#900000",
    "#00308f",
    ("#ffffff", "#900000"),
)
DARK = Palette(
    "dark",
    "#ffffff",
    "#000000",
    "#c8c8c8",
    "#5cff5c",
    "#ffd75f",
    "#ff9c9c",
    "#7fd7ff",
    ("#ffffff", "#900000"),
)
