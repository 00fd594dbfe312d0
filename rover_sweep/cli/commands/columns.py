"""`rover-sweep columns`: write the column map of a file of another system, with a reason for each line."""

from __future__ import annotations

import shlex

import click

from rover_sweep.cli.options import RATE, argument, option, options, refuse_input, write_text
from rover_sweep.errors import UsageError

CORRECT = "to correct the map, write it with --out columns.toml"


@click.command()
@options
def columns(
    files: tuple[str, ...] = argument("FILE...", nargs=-1, required=True),
    out: str = option("Column map to write (TOML). [default: stdout]", metavar="FILE", default="-"),
    rate: float | None = RATE,
) -> None:
    """Find time, steering, yaw rate, speed and accelerations in FILEs that another system recorded.

    FILE is a .csv (also .tsv or .txt), .parquet, .mat, .ulg (PX4), .bag, .db3 or .mcap, or the folder of a
    ROS 2 bag. Several FILEs are of one drive, and are joined by their clocks.

    Writes a column map with a certainty and a reason for each line. Correct it, and give it to identify,
    diagnose and the others with --columns. What could not be found is left as a comment to complete.
    """
    from rover_sweep.cli.views.asking import long_work
    from rover_sweep.cli.views.output import echo, say_next
    from rover_sweep.logs.read import READ, existing_log
    from rover_sweep.logs.readers.guessed_columns import guess_columns
    from rover_sweep.logs.readers.tables import is_table_file, read_table

    paths = [existing_log(file) for file in files]
    if others := [path.name for path in paths if not is_table_file(path)]:
        own = others[0].lower().endswith((".bin", ".tlog"))
        as_it_is = "needs no column map: rover-sweep identify reads it as it is"
        raise UsageError(f"{others[0]} {as_it_is if own else f'cannot be read; give {READ}'}")
    refuse_input(out, *paths)
    with long_work("comparing the columns"):
        guess = guess_columns(read_table(paths), rate or 0.0)
    given = shlex.join(["+".join(files), "--columns", "columns.toml" if out == "-" else out])
    command = f"rover-sweep identify {given} --out report"
    head = f"# Column map of {guess.table}, from its names and values: correct it (keys: docs/formats.md)\n"
    write_text(out, f"{head}# {command}\n\n{guess.text()}", "written; look through its reasons")
    if guess.missing:
        advice = guess.obstacle or "complete the commented lines"
        echo(f"not found: {', '.join(guess.missing)}; {advice}", err=True)
    else:
        even = f" --rate {rate:g}" if rate else ""
        plain = f"rover-sweep identify {shlex.quote('+'.join(files))}{even} --out report"
        say_next(*((plain, CORRECT) if out == "-" else (command,)))
