"""Files that are replaced completely or not at all."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from itertools import count
from pathlib import Path

from rover_sweep.errors import UsageError


def write_file(path: Path, content: str | bytes) -> Path:
    """Replaces a file in one step; UsageError when it cannot be written."""
    data = content.encode("utf-8") if isinstance(content, str) else content
    temporary = ""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=path.parent, prefix=f".{path.name}.", delete=False) as file:
            temporary = file.name
            file.write(data)
        os.chmod(temporary, 0o644)  # temporary files are private; a report is to be shared
        os.replace(temporary, path)
    except OSError as error:
        if temporary:
            Path(temporary).unlink(missing_ok=True)
        raise UsageError(f"{path} cannot be written: {error.strerror}; choose another place") from error
    return path


def remove_file(path: Path) -> None:
    """Removes a file if it exists; UsageError when that is not allowed."""
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        raise UsageError(f"{path} cannot be written: {error.strerror}; choose another place") from error


def numbered(path: Path) -> Iterator[Path]:
    """The path, then with -2, -3, ... before its suffix."""
    yield path
    yield from (path.with_name(f"{path.stem}-{n}{path.suffix}") for n in count(2))
