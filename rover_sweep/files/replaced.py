"""Files that are either the old ones or wholly the new ones."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from rover_sweep.errors import UsageError


def write_file(path: Path, content: str | bytes) -> Path:
    """Writes a file by replacing it at once; UsageError where the place cannot be written."""
    data = content.encode("utf-8") if isinstance(content, str) else content
    temporary = ""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=path.parent, prefix=f".{path.name}.", delete=False) as file:
            temporary = file.name
            file.write(data)
        os.chmod(temporary, 0o644)  # temporary files are the owner's alone; a report is to be shared
        os.replace(temporary, path)
    except OSError as error:
        if temporary:
            Path(temporary).unlink(missing_ok=True)
        raise UsageError(f"{path} cannot be written: {error.strerror}; give another place") from error
    return path


def remove_file(path: Path) -> None:
    """Removes a file if it is there; UsageError where that is not allowed."""
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        raise UsageError(f"{path} cannot be written: {error.strerror}; give another place") from error
