"""The number of messages that the autopilot could not write to a log."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rover_sweep.logs.readers.dataflash import open_parts


def dropped_messages(path: Path) -> int | None:
    """From DSF.Dp, which counts from boot (AP_Logger_File); None for a log without it."""
    dropped = [np.ptp(part.rows("DSF", "Dp")["Dp"]) for part in open_parts(path) if part.has("DSF", "Dp")]
    return int(sum(dropped)) if dropped else None
