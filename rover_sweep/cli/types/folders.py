"""Output folders: checked before the work starts, and never one that contains earlier work."""

from __future__ import annotations

import tempfile
from itertools import count
from pathlib import Path

from rover_sweep.errors import UsageError

_SESSION = ("session.json", "*.tlog", "*.BIN", "report")


def check_writable(folder: Path) -> None:
    """UsageError if `folder` is not writable; leaves nothing behind."""
    try:
        made = [p for p in (folder, *folder.parents) if not p.exists()]
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
        for path in made:
            path.rmdir()
    except OSError as error:
        raise UsageError(f"{folder} cannot be written: {error.strerror}; give another --out") from error


def check_report_folder(folder: Path, documents: tuple[str, ...], written: tuple[str, ...]) -> None:
    """UsageError if `folder` is not writable, or has files that a report would replace and are none of one.

    documents: names of the files that a report always has. written: glob patterns of the others.
    """
    ours = any((folder / name).is_file() for name in documents)
    if not ours and (held := _held(folder, written)):
        raise UsageError(
            f"{folder} has {held} but no {documents[0]}: this program did not write it; give another --out"
        )
    check_writable(folder)


def session_folder(given: str | None, name: str, also: tuple[str, ...] = ()) -> Path:
    """Create an empty folder for a session: `given`, else the first free of `name`, `name`-2, ...

    also: glob patterns of further files that must not exist. UsageError if the given folder contains a
    session, or is not writable.
    """
    if given is None:
        numbered = (Path(name if n == 1 else f"{name}-{n}") for n in count(1))
        folder = next(p for p in numbered if not p.exists())
    else:
        folder = Path(given)
        if held := _held(folder, (*_SESSION, *also)):
            raise UsageError(
                f"{folder} already contains a session ({held}); continue it with `rover-sweep resume`, or "
                "give another --out"
            )
    check_writable(folder)
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def _held(folder: Path, patterns: tuple[str, ...]) -> str | None:
    """Name of the first file in the folder that matches."""
    if not folder.is_dir():
        return None
    found = (path for pattern in patterns for path in sorted(folder.glob(pattern)))
    return next((str(path.relative_to(folder)) for path in found), None)
