"""`rover-sweep twin`: correct a simulation until it agrees with recordings; `twin serve`: drive on it."""

from __future__ import annotations

from pathlib import Path

import click

from rover_sweep.cli.types.options import reading_options
from rover_sweep.errors import UsageError

SIMULATORS = ("plant", "embedded", "ardurover")


class _Commands(click.Group):
    """`twin serve DIR` is a command of its own; every other call is `twin RUN...`."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        if not args or args[0] not in self.commands:
            args = ["correct", *args]
        return super().parse_args(ctx, args)


@click.group(cls=_Commands)
def twin() -> None:
    """Correct a simulation until it agrees with recordings, or serve it."""


@twin.command()
@click.argument("runs", nargs=-1, required=True, metavar="RUN...")
@click.option(
    "--variant",
    default="nominal",
    show_default=True,
    metavar="NAME|FILE",
    help="Simulated rover to begin with, as in redrive. A named one gets the numbers of the vehicle file.",
)
@click.option(
    "--hold-out",
    "held_out",
    multiple=True,
    metavar="RUN",
    help="Run that only checks the result; may be repeated (default: the doublets).",
)
@click.option(
    "--vehicle",
    "vehicles",
    multiple=True,
    metavar="FILE|SIMULATOR",
    help="Vehicle file (default: the session's, or rover.toml here); or embedded or ardurover, which then "
    "drives the corrected rover once more. May be given twice.",
)
@click.option(
    "--ardurover",
    type=click.Path(dir_okay=False),
    metavar="FILE",
    help="The ArduRover SITL program (else $ROVER_SWEEP_ARDUROVER, else the PATH).",
)
@click.option("--seed", type=click.IntRange(min=0), default=1, show_default=True, help="Random seed.")
@reading_options
@click.option(
    "--out",
    required=True,
    type=click.Path(file_okay=False),
    metavar="DIR",
    help="Folder of the report and of the variant file; created if missing.",
)
@click.option("--json", "as_json", is_flag=True, help="Print twin.json on stdout; tables go to stderr.")
def correct(
    runs: tuple[str, ...],
    variant: str,
    held_out: tuple[str, ...],
    vehicles: tuple[str, ...],
    ardurover: str | None,
    seed: int,
    columns: str | None,
    gyro_filter: float | None,
    accel_filter: float | None,
    system: int | None,
    out: str,
    as_json: bool,
) -> None:
    """Compare a simulated rover with RUNs, correct it, and drive it again until it agrees.

    The simulated rover repeats the steering and speed of each RUN (.BIN, .tlog). What differs is corrected in
    a variant file, DIR/variant.toml: numbers and effects, each with its reason. Held-out runs are only
    compared. Ctrl-C ends with the corrections so far. `rover-sweep twin serve DIR` drives the result.
    """
    from rover_sweep.api.read import Reading
    from rover_sweep.cli.driving.show_twin import TwinCall, show_twin
    from rover_sweep.cli.types.folders import check_writable
    from rover_sweep.cli.types.options import filter_overrides, vehicle_path

    simulators = [v for v in vehicles if v in SIMULATORS]
    files = [v for v in vehicles if v not in SIMULATORS]
    if len(simulators) > 1 or len(files) > 1:
        raise UsageError(
            f"--vehicle {', '.join(vehicles)}: give at most one vehicle file, and at most one of "
            f"{', '.join(SIMULATORS)}"
        )
    check_writable(Path(out))
    show_twin(
        TwinCall(
            runs,
            held_out,
            Path(vehicle_path(files[0] if files else None, runs)),
            variant,
            simulators[0] if simulators else "plant",
            Path(ardurover) if ardurover else None,
            seed,
            Reading(columns, filter_overrides(gyro_filter, accel_filter), system),
            Path(out),
        ),
        as_json,
    )


@twin.command()
@click.argument("directory", metavar="DIR", type=click.Path(exists=True))
@click.option(
    "--ardurover",
    type=click.Path(dir_okay=False),
    metavar="FILE",
    help="The ArduRover SITL program (else $ROVER_SWEEP_ARDUROVER, else the PATH).",
)
@click.option("--physics", is_flag=True, help="Only the physics; start the firmware yourself.")
@click.option(
    "--instance", type=click.IntRange(min=0), default=0, show_default=True, help="Moves the ports by 10."
)
@click.option("--seed", type=click.IntRange(min=0), default=1, show_default=True, help="Random seed.")
def serve(directory: str, ardurover: str | None, physics: bool, instance: int, seed: int) -> None:
    """Serve the corrected rover of DIR (or a variant file) to the official firmware, on this machine only.

    Starts ArduRover's SITL with the twin as its physics and prints where to connect a ground station; nothing
    arms or moves by itself. --physics serves only the JSON interface. Ctrl-C ends it.
    """
    from rover_sweep.cli.driving.serve_twin import serve_twin

    serve_twin(Path(directory), Path(ardurover) if ardurover else None, physics, instance, seed)
