"""The applet's own messages in a DataFlash log: SWEP of a steering run, SWET of a throttle sweep."""

from __future__ import annotations

import numpy as np

from rover_sweep.data.recording import Signal
from rover_sweep.logs.log import AppletRows, increasing
from rover_sweep.logs.readers.dataflash import DataFlash


def applet_rows(flash: DataFlash, message: str) -> AppletRows | None:
    """Number and state of the runs; None without that message."""
    if not flash.has(message, "Run", "St", "T"):
        return None
    rows = flash.rows(message)
    t, (run, state, clock) = increasing(
        flash.seconds(message, rows), *(flash.column(message, c, rows) for c in ("Run", "St", "T"))
    )
    return AppletRows(t, run, state, clock)


def applet_output(flash: DataFlash, message: str) -> Signal | None:
    """The applet's output [us] as a staircase: Out as read back, or Cmd if Out is not the servo output.

    Out is read immediately after it is set, and reaches the servo at the next main loop.
    """
    if not flash.has(message, "Cmd", "Out"):
        return None
    rows = flash.rows(message)
    t, (wanted, out) = increasing(
        flash.seconds(message, rows), flash.column(message, "Cmd", rows), flash.column(message, "Out", rows)
    )
    is_output = np.ptp(out) > 0 and float(np.min(out)) > 0
    name = f"{message}.Out" if is_output else f"{message}.Cmd"
    return Signal(t, out if is_output else wanted, "us", name, hold=True)
