"""One program at a time drives into a folder; a program that is killed gives it free."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

from rover_sweep.errors import UsageError


class Claim:
    """Held from its making to `close`. UsageError where another holds it; none where there are no locks."""

    def __init__(self, folder: Path) -> None:
        self._held = -1
        with contextlib.suppress(ImportError, OSError):  # not POSIX; a file system without locks
            import fcntl

            self._held = os.open(folder, os.O_RDONLY)
            try:
                fcntl.flock(self._held, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                self.close()
                words = f"another rover-sweep drives into {folder}: end it, or take another folder"
                raise UsageError(words) from None

    def close(self) -> None:
        """Harmless a second time."""
        held, self._held = self._held, -1
        if held >= 0:
            os.close(held)
