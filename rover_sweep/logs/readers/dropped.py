"""How many messages the autopilot could not write into a log."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rover_sweep.logs.readers.dataflash import open_parts


def dropped_messages(path: Path) -> int | None:
    """By DSF.Dp, which counts on from boot (AP_Logger_File); None for a log that does not tell."""
    told = [np.ptp(part.rows("DSF")["Dp"]) for part in open_parts(path) if part.has("DSF", "Dp")]
    return int(sum(told)) if told else None
