"""A lock, so that only one program at a time uses a session's folder; the end of the program releases it."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

from rover_sweep.errors import UsageError


class Claim:
    """Held until `close`. UsageError if another program holds it; no lock on systems without them."""

    def __init__(self, folder: Path) -> None:
        self._held = -1
        with contextlib.suppress(ImportError, OSError):  # not POSIX; a file system without locks
            import fcntl

            self._held = os.open(folder, os.O_RDONLY)
            try:
                fcntl.flock(self._held, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                self.close()
                words = f"another rover-sweep uses {folder}; end it, or give another folder"
                raise UsageError(words) from None

    def close(self) -> None:
        """Release the lock; may be repeated."""
        held, self._held = self._held, -1
        if held >= 0:
            os.close(held)
