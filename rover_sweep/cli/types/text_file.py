"""Text that a command was asked to write: to stdout for `-`, else into a file of a folder that is there."""

from __future__ import annotations

from pathlib import Path

from rover_sweep.cli.views.output import echo
from rover_sweep.errors import UsageError


def refuse_no_folder(output: str) -> None:
    """UsageError where the file's folder is not there: a slip of the pen is not to become a folder."""
    folder = Path(output).parent
    if output != "-" and not folder.is_dir():
        raise UsageError(f"{output} cannot be written: there is no folder {folder}; make it, or give another")


def write_text(output: str, text: str, told: str = "written") -> None:
    """`told` of the file is said on stderr."""
    if output == "-":
        echo(text, nl=False)
        return
    from rover_sweep.files.replaced import write_file

    refuse_no_folder(output)
    write_file(Path(output), text)
    echo(f"{output}: {told}", err=True)
