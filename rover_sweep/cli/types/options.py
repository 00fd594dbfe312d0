"""Option types that several commands share."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import click

from rover_sweep.errors import UsageError

OUTPUTS = ("r", "ay", "vydot", "p")


class BandType(click.ParamType):
    """The frequency band used of one response, e.g. p=0.6:20 (rad/s)."""

    name = "RESPONSE=LOW:HIGH"

    def convert(
        self, value: object, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[str, tuple[float, float]]:
        """(response, (low, high))."""
        name, _, limits = str(value).partition("=")
        low, _, high = limits.partition(":")
        try:
            band = float(low), float(high)
        except ValueError:
            self.fail(f"{value!r} is not a band such as p=0.6:20 (rad/s)", param, ctx)
        if name not in OUTPUTS or not 0 < band[0] < band[1]:
            self.fail(f"{value!r}: use one of {', '.join(OUTPUTS)} and 0 < low < high in rad/s", param, ctx)
        return name, band


class NumberRange(click.FloatRange):
    """A finite number within bounds; click lets NaN pass any bound, and infinity an open end."""

    name = "number"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """The number."""
        number = float(super().convert(value, param, ctx))
        if not math.isfinite(number):
            self.fail(f"{value!r} is not a finite number", param, ctx)
        return number


class NumbersType(click.ParamType):
    """Positive numbers joined by commas, e.g. 5,8,12,18,27."""

    name = "N,N,..."

    def convert(
        self, value: object, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, ...]:
        """The numbers."""
        try:
            numbers = tuple(float(part) for part in str(value).split(","))
        except ValueError:
            self.fail(f"{value!r} is not a list of numbers such as 5,8,12", param, ctx)
        if not all(0 < n < math.inf for n in numbers):
            self.fail(f"{value!r}: every number must be positive and finite", param, ctx)
        return numbers


class ChoicesType(click.ParamType):
    """Names joined by commas out of a fixed set."""

    name = "NAME,NAME,..."

    def __init__(self, allowed: tuple[str, ...]) -> None:
        self.allowed = allowed

    def convert(
        self, value: object, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[str, ...]:
        """The names, in the order given, each once."""
        names = tuple(dict.fromkeys(part.strip() for part in str(value).split(",")))
        wrong = [n for n in names if n not in self.allowed]
        if wrong:
            self.fail(f"there is no {wrong[0]!r}; choose from {', '.join(self.allowed)}", param, ctx)
        return names


class NamesType(click.ParamType):
    """Names joined by commas; the command checks that they exist."""

    def __init__(self, name: str) -> None:
        self.name = name

    def convert(
        self, value: object, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[str, ...]:
        """The names, in the order given."""
        if isinstance(value, tuple):
            return value
        names = tuple(part.strip() for part in str(value).split(",") if part.strip())
        if not names:
            self.fail(f"{value!r} contains no name; give a name or remove the option", param, ctx)
        return names


EFFECTS = NamesType("ID,ID,...")


def vehicle_path(given: str | None, runs: Sequence[str] = ()) -> str:
    """The vehicle file: as given, else that of a session among the runs, else rover.toml here."""
    from rover_sweep.session.folder import VEHICLE_FILE, kept_vehicle_file

    if given:
        return given
    if kept := kept_vehicle_file(runs):
        return str(kept)
    if Path(VEHICLE_FILE).is_file():
        return VEHICLE_FILE
    raise UsageError(
        "no vehicle file: give --vehicle rover.toml; create one with "
        "`rover-sweep vehicle --example > rover.toml`"
    )


def filter_overrides(gyro: float | None, accel: float | None) -> dict[str, float] | None:
    """{"gyro_hz", "accel_hz"} of the options that were given, None without any."""
    given = {"gyro_hz": gyro, "accel_hz": accel}
    return {k: v for k, v in given.items() if v is not None} or None


def reading_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """--columns, --system, --gyro-filter and --accel-filter."""
    for decorate in (
        click.option(
            "--accel-filter",
            type=NumberRange(0),
            metavar="HZ",
            help="INS_ACCEL_FILTER during the drive, if the log lacks it (0: off).",
        ),
        click.option(
            "--gyro-filter",
            type=NumberRange(0),
            metavar="HZ",
            help="INS_GYRO_FILTER during the drive, if the log lacks it (0: off).",
        ),
        click.option(
            "--system",
            type=click.IntRange(1, 255),
            metavar="N",
            help="MAVLink system id of the vehicle, if a .tlog contains several.",
        ),
        click.option(
            "--columns",
            type=click.Path(dir_okay=False),
            metavar="FILE",
            help="Column map of .csv recordings (TOML).",
        ),
    ):
        command = decorate(command)
    return command


def output_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """--json and --full, of the commands that identify."""
    for decorate in (
        click.option(
            "--full",
            "--verbose",
            "full",
            is_flag=True,
            help="Show all tables: every model, costs, verification, handling, steps of the reduction.",
        ),
        click.option(
            "--json",
            "as_json",
            is_flag=True,
            help="Print identification.json on stdout; tables go to stderr.",
        ),
    ):
        command = decorate(command)
    return command
