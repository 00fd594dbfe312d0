"""Option types for measured numbers: a number with its standard deviation, and times."""

from __future__ import annotations

import re

import click

from rover_sweep.data.vehicle_file import Measured


class MeasuredType(click.ParamType):
    """A positive number, with its standard deviation after +- or ±, e.g. 1.200+-0.003."""

    name = "NUMBER[+-SD]"

    def __init__(self, low: float, high: float, unit: str, hint: str = "") -> None:
        self.low, self.high, self.unit, self.hint = low, high, unit, hint

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> Measured:
        """The number; a usage error if it is not a number or outside low..high."""
        if isinstance(value, Measured):
            return value
        parts = [part.strip() for part in re.split(r"\+-|\+/-|±", str(value))]
        try:
            numbers = [float(part) for part in parts]
        except ValueError:
            self.fail(f"{value!r} is not a number such as 1.2 or 1.2+-0.01 ({self.unit})", param, ctx)
        if len(numbers) > 2 or not self.low <= numbers[0] <= self.high:
            self.fail(
                f"{value!r} is outside {self.low:g}..{self.high:g} {self.unit}; {self.hint or 'check it'}",
                param,
                ctx,
            )
        if len(numbers) == 2 and not 0 <= numbers[1] < numbers[0]:
            self.fail(
                f"{value!r}: the uncertainty must be between 0 and the number, in {self.unit}", param, ctx
            )
        return Measured(numbers[0], numbers[1] if len(numbers) == 2 else None)


class TimesType(click.ParamType):
    """Times in s, separated by commas or blanks."""

    name = "S,S,.."

    def convert(
        self, value: object, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, ...]:
        """The times; a usage error if one is not a positive number."""
        if isinstance(value, tuple):
            return value
        try:
            times = tuple(float(part) for part in re.split(r"[,\s]+", str(value).strip()))
        except ValueError:
            self.fail(f"{value!r} is not a list of times in s such as 47.5,47.3,47.6", param, ctx)
        if not all(0 < time < 3600 for time in times):
            self.fail(f"{value!r}: every time must be between 0 and 3600 s", param, ctx)
        return times
