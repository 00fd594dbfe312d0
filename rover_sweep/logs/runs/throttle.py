"""Finds the throttle sweeps of a log by the applet's SWET messages."""

from __future__ import annotations

import numpy as np

from rover_sweep.data.throttle_run import ThrottleRun
from rover_sweep.errors import DataRefused
from rover_sweep.files.printable import printable
from rover_sweep.logs.log import AppletRows, Log
from rover_sweep.logs.readers.main_loop import at_main_loops
from rover_sweep.logs.runs.applet import END, OVERRIDE_STATES, STOPPED, applet_runs

SHORTEST = 15.0  # s of override
COASTING = 20.0  # s kept after the override


def throttle_runs(log: Log) -> tuple[ThrottleRun, ...]:
    """All throttle sweeps of a log; empty without one. DataRefused for sweeps without a recorded speed."""
    if log.throttle_applet is None:
        return ()
    if "speed" not in log.signals:
        raise DataRefused(f"{log.name}: a throttle sweep without a recorded speed; log the EKF (XKF1)")
    every = [rows for rows in applet_runs(log.throttle_applet) if _override(rows).any()]
    found = [_run(log, rows, len(every)) for rows in every]
    return tuple(run for run in found if run.span[1] - run.span[0] >= SHORTEST)


def _override(rows: AppletRows) -> np.ndarray:
    return np.isin(rows.state, list(OVERRIDE_STATES))


def _run(log: Log, rows: AppletRows, count: int) -> ThrottleRun:
    driven = rows.t[_override(rows)]
    start, end = float(driven[0]), float(driven[-1])
    pwm = at_main_loops(log.signals["throttle"], log.loops)
    kept = start - 1.0, end + COASTING
    return ThrottleRun(
        name=f"{log.name} run {rows.run[0]:.0f}" if count > 1 else log.name,
        pwm=pwm.between(*kept),
        speed=log.signals["speed"].between(*kept),
        span=(start, end),
        swept=(log.parameters.get("SWP_WMIN", 0.2), log.parameters.get("SWP_WMAX", 8.0)),
        parameters=log.parameters,
        stopped=_stopped(log, rows, end),
        firmware=log.firmware,
        sources=log.sources,
    )


def _stopped(log: Log, rows: AppletRows, end: float) -> str:
    """Why the applet ended the run early, "" if it did not."""
    stops = rows.t[(rows.state == STOPPED) & (rows.t >= end)]
    if not stops.size:
        return ""
    said = (text for t, text in log.marks if abs(t - stops[0]) < 1.0 and END.match(text))
    return printable(next(said, "reason not logged"))
