"""Two sets of colours, each text of which stands against its ground with a WCAG contrast of 7 or more.

Black on white for the sun, white on black for dusk. A colour never says anything alone: the words
beside it do (`words.py`).
"""

from __future__ import annotations

from dataclasses import dataclass

LEAST_CONTRAST = 7.0  # WCAG 2.1, 1.4.6 (AAA)


@dataclass(frozen=True)
class Palette:
    """Colours as #rrggbb. alarm: (text, ground) of the ABORT bar and of what is wrong now."""

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
        """Style of what is chosen."""
        return f"bold {self.ground} on {self.ink}"

    @property
    def alarming(self) -> str:
        return f"bold {self.alarm[0]} on {self.alarm[1]}"

    @property
    def asking(self) -> str:
        """Style of what somebody has to do."""
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


def contrast(one: str, other: str) -> float:
    """WCAG 2.1 contrast ratio of two colours #rrggbb, 1..21."""
    light, dark = sorted((_luminance(one), _luminance(other)), reverse=True)
    return (light + 0.05) / (dark + 0.05)


def _luminance(colour: str) -> float:
    shares = (int(colour[n : n + 2], 16) / 255 for n in (1, 3, 5))
    linear = [s / 12.92 if s <= 0.04045 else ((s + 0.055) / 1.055) ** 2.4 for s in shares]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]
