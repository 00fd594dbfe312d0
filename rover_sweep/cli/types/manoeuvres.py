"""Manoeuvres and limits on the command line: 150 or 150,0.3,25,55 or 150,wmax=20; roll_max=20."""

from __future__ import annotations

import math

import click

from rover_sweep.manoeuvre.multisine import Multisine
from rover_sweep.manoeuvre.sweep import BiasSweep, Doublet, Manoeuvre, Sweep, ThrottleSweep

_SWEEP = {
    "amplitude": "amplitude",
    "wmin": "w_min",
    "wmax": "w_max",
    "trec": "t_rec",
    "fade": "fade",
    "dwell": "dwell",
    "straight": "straight",
}
_DOUBLET = {name: name for name in ("amplitude", "pulse", "pause", "count", "straight")}
_MULTISINE = dict(list(_SWEEP.items())[:4]) | {"periods": "periods"} | dict(list(_SWEEP.items())[4:])
_BIAS_SWEEP = {"amplitude": "amplitude", "bias": "bias"} | _SWEEP
_KEYS: dict[type[Manoeuvre], tuple[dict[str, str], int]] = {  # names in order, number of them shown in --help
    Sweep: (_SWEEP, 4),
    Doublet: (_DOUBLET, 3),
    Multisine: (_MULTISINE, 5),
    BiasSweep: (_BIAS_SWEEP, 5),
    ThrottleSweep: (_SWEEP, 4),
}
_WHOLE = ("count", "periods")
LIMITS = ("pwm_max", "roll_max", "p_max", "r_max", "v_min", "v_max", "still", "gcs")


class ManoeuvreType(click.ParamType):
    """A manoeuvre: its numbers in their order, or by name, joined by commas."""

    def __init__(self, kind: type[Manoeuvre]) -> None:
        self.kind = kind
        self.keys, shown = _KEYS[kind]
        first = [name.upper() for name in list(self.keys)[:shown]]
        self.name = f"{first[0]}[,{','.join(first[1:])}]"

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> Manoeuvre:
        """The manoeuvre; a usage error that names the wrong part."""
        if isinstance(value, Manoeuvre):
            return value
        numbers: dict[str, float] = {}
        for key, part in zip(self.keys, str(value).split(","), strict=False):
            name, _, text = part.rpartition("=")
            name = name.strip().lower() or key
            if name not in self.keys:
                self.fail(f"{value!r}: there is no {name!r}; there are {', '.join(self.keys)}", param, ctx)
            numbers[self.keys[name]] = self._number(text, str(value), param, ctx)
        if len(str(value).split(",")) > len(self.keys):
            self.fail(f"{value!r} has more numbers than {', '.join(self.keys)}", param, ctx)
        for name in (name for name in _WHOLE if name in numbers):
            if not numbers[name].is_integer():
                self.fail(f"{value!r}: {name} must be a whole number", param, ctx)
            numbers[name] = int(numbers[name])
        try:
            return self.kind(**numbers)  # type: ignore[arg-type]
        except ValueError as error:
            self.fail(str(error), param, ctx)

    def _number(
        self, text: str, whole: str, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        try:
            number = float(text)
        except ValueError:
            number = math.nan
        if not math.isfinite(number):
            self.fail(
                f"{whole!r}: {text!r} is not a number; write it as 150,0.3,25,55 or 150,wmax=20", param, ctx
            )
        return number


class LimitType(click.ParamType):
    """A limit of the applet by its name without SWP_, e.g. roll_max=20."""

    name = "NAME=VALUE"

    def convert(
        self, value: object, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[str, float]:
        """(name, value)."""
        name, _, text = str(value).partition("=")
        name = name.strip().lower().removeprefix("swp_")
        if name not in LIMITS:
            self.fail(f"{value!r}: there is no limit {name!r}; there are {', '.join(LIMITS)}", param, ctx)
        try:
            number = float(text)
        except ValueError:
            number = math.nan
        if not math.isfinite(number):
            self.fail(f"{value!r}: {text!r} is not a number", param, ctx)
        return name, number
