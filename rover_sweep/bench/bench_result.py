"""The result of a bench: numbers with intervals, and the reasons for missing ones."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, isfinite, nan

LEVEL = 0.90  # of every interval


@dataclass(frozen=True)
class Number:
    """A number with its standard deviation and interval. key: in the vehicle file, '' if it has none."""

    name: str
    unit: str
    value: float
    sd: float
    low: float
    high: float
    meaning: str
    key: str = ""

    @property
    def determined(self) -> bool:
        """Whether the data determine it (not, for example, a rate limit that no step reached)."""
        return isfinite(self.value) and isfinite(self.sd)

    def __str__(self) -> str:
        return f"{self.value:.4g} {self.unit} ({self.low:.4g} to {self.high:.4g})"


@dataclass(frozen=True)
class BenchResult:
    """untold: sentences on numbers not measured, and why; remarks: sentences; residual: rms [rad]; samples:
    number of angles."""

    source: str
    numbers: tuple[Number, ...]
    untold: tuple[str, ...]
    remarks: tuple[str, ...]
    residual: float
    samples: int

    def get(self, name: str) -> Number | None:
        """A number by its name."""
        return next((number for number in self.numbers if number.name == name), None)


def interval(
    name: str,
    unit: str,
    value: float,
    sd: float,
    factor: float,
    meaning: str,
    key: str = "",
    least: float = -inf,
) -> Number:
    """The number value +- factor sd; least: lower bound of the value and of the interval."""
    value, sd = float(value), float(sd)  # plain, as files and JSON take them
    low, high = value - factor * sd, value + factor * sd
    return Number(name, unit, max(value, least), sd, max(low, least), max(high, least), meaning, key)


def rate_limit(slowness: float, sd: float, factor: float) -> Number:
    """The rate limit [rad/s] from its inverse [s/rad]; NaN with only a lower bound if no step reached it."""
    slowness, sd = float(slowness), float(sd)
    least, most = slowness - factor * sd, slowness + factor * sd
    meaning = "fastest rate of the road wheel"
    key = "steering.servo_rate_limit"
    if least <= 0:
        return Number("servo_rate_limit", "rad/s", nan, nan, 1.0 / max(most, 1e-6), inf, meaning, key)
    rate = 1.0 / slowness
    return Number("servo_rate_limit", "rad/s", rate, sd * rate**2, 1.0 / most, 1.0 / least, meaning, key)
