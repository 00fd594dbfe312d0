"""Simulated rovers of `dry-run` and `run`: their vehicle files and true parameters."""

from __future__ import annotations

from math import radians, sin
from pathlib import Path
from typing import TYPE_CHECKING

from rover_sweep.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Callable

    from rich.console import RenderableType

    from rover_sweep.data.vehicle_file import Vehicle
    from rover_sweep.identification.pipeline import Identification

SIMULATORS = ("embedded", "ardurover")


def variants() -> tuple[str, ...]:
    """Names of the built-in physics."""
    from sitl.plant.variant import variant_names

    return variant_names()


def rover_text(variant: str) -> str:
    """rover.toml of a simulated rover: the values that an owner could measure."""
    from sitl.plant.variant import load_variant
    from sitl.rover_file import rover_file

    try:
        return rover_file(load_variant(variant), variant)
    except ValueError as error:
        raise UsageError(str(error)) from error


def firmware_rover_text() -> str:
    """rover.toml of ArduPilot's own simulated rover (SIM_Rover.h, 4.6.3): 35 deg of steering at 500 us, and
    the wheelbase that follows from its turning circle of 1.8 m. It has no tyres and no body, so the masses
    (those of the nominal plant) do not affect the identified model."""
    from dataclasses import replace

    from sitl.plant.variant import load_variant
    from sitl.rover_file import rover_file

    half = 1.8 / 2 * sin(radians(35)) / 2
    own = replace(
        load_variant("nominal"),
        rad_per_us=round(radians(35) / 500, 6),
        cg_to_front_axle=round(half, 4),
        cg_to_rear_axle=round(half, 4),
    )
    return rover_file(own, "of the firmware")


def vehicle_in(folder: Path, rover_file: str | None, text: str | None) -> tuple[Vehicle, Path]:
    """(vehicle, path) of the given file, else of the text, written into the folder."""
    from rover_sweep.data.vehicle_file import load

    path = Path(rover_file) if rover_file else folder / "rover.toml"
    if text is not None:
        path.write_text(text, encoding="utf-8")
    return load(path), path


def truth_view(variant: str) -> Callable[[Identification], RenderableType]:
    """A function that renders the table of true and identified parameters."""

    def view(result: Identification) -> RenderableType:
        from rover_sweep.cli.views.truth import truth_table
        from rover_sweep.report.identification.terminal import rich_table
        from sitl.plant.effects.replaced_numbers import resolved
        from sitl.plant.variant import load_variant

        table = truth_table(result, resolved(load_variant(variant)))
        return rich_table(table) if table else ""

    return view
