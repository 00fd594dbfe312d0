"""Units in which a report shows accelerations: SI, or the paper's ft/s². Angles are in deg in both."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

FOOT = 0.3048  # m


@dataclass(frozen=True)
class ShownUnits:
    """name: as an option; acceleration: its unit; per_si: number of them in 1 m/s²."""

    name: str
    acceleration: str
    per_si: float

    def words(self, text: str) -> str:
        """A label or unit with the shown unit of acceleration in place of m/s²."""
        return text.replace("m/s²", self.acceleration).replace("m/s^2", self.acceleration)

    def factor(self, unit: str) -> float:
        """What a number in an SI unit, such as "m/s^2 per rad", is multiplied by."""
        return self.per_si if unit.replace("²", "^2").startswith("m/s^2") else 1.0

    def db(self, unit: str) -> float:
        """What is added to a magnitude in dB of an SI unit."""
        return float(20 * np.log10(self.factor(unit)))


SI = ShownUnits("SI", "m/s²", 1.0)
PAPER = ShownUnits("paper", "ft/s²", 1 / FOOT)
SHOWN_UNITS = {units.name: units for units in (SI, PAPER)}
