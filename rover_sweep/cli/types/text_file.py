"""Text output of a command: to stdout for `-`, else into a file in an existing folder."""

from __future__ import annotations

from pathlib import Path

from rover_sweep.cli.views.output import echo
from rover_sweep.errors import UsageError

READ_IN_FOLDERS = ("identification.json", "speed.json", "diagnosis.json", "session.json", "rover.toml")


def refuse_no_folder(output: str) -> None:
    """UsageError if the file's folder does not exist; a mistyped folder is not created."""
    folder = Path(output).parent
    if output != "-" and not folder.is_dir():
        raise UsageError(f"cannot write {output}: there is no folder {folder}; create it, or give another")


def refuse_input(output: str, *inputs: str | Path | None) -> None:
    """UsageError if the file is one of the inputs, or what is read of a folder that is one."""
    path = Path(output).resolve()
    for given in (Path(given).resolve() for given in inputs if given is not None):
        if path == given or (path.parent == given and path.name in READ_IN_FOLDERS):
            raise UsageError(f"{output} is an input of this command; give another name to write to")


def write_text(output: str, text: str, report: str = "written") -> None:
    """Write the text; for a file, print its name and `report` on stderr."""
    if output == "-":
        echo(text, nl=False)
        return
    from rover_sweep.files.replaced import write_file

    refuse_no_folder(output)
    write_file(Path(output), text)
    echo(f"{output}: {report}", err=True)
