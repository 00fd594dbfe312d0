"""The applet's states, run by run, and its messages in a log."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from itertools import pairwise

import numpy as np

from rover_sweep.data.recording import Kind, ThrottleRun
from rover_sweep.errors import DataRefused
from rover_sweep.files.documents import printable
from rover_sweep.logs.log import STEERING, AppletRows, Log, output_channel
from rover_sweep.logs.readers.vehicle_clock import at_main_loops

WAVE_STATES = {4, 5, 6, 7}  # fade-in, dwell, law or doublet, fade-out
OVERRIDE_STATES = {3, 8} | WAVE_STATES
STOPPED = 10
OLD_STATE = 2  # the only state that the applet of 2025 logged
ANNOUNCED_KINDS: Mapping[str, Kind] = {"start multisine": "multisine", "start bias sweep": "bias_sweep"}
START = re.compile(r"^SW[PX]\b.*\bstart\b(?! throttle)", re.IGNORECASE)
END = re.compile(r"^SW[PX]\b.*\b(done|stop|stopped|abort|aborted)\b", re.IGNORECASE)


def applet_runs(rows: AppletRows) -> Iterator[AppletRows]:
    """The applet's rows of each run; the old applet's clock T restarts with each run."""
    keep = np.ones(rows.t.size, bool)  # without damaged rows, whose neighbours are equal and other
    for x in (rows.run, rows.state):
        keep[1:-1] &= (x[1:-1] == x[:-2]) | (x[:-2] != x[2:])
    rows = rows.where(keep)
    old = (rows.state == OLD_STATE) & (rows.clock >= 0)
    restarted = old[1:] & old[:-1] & (np.diff(rows.clock) < -0.5)
    cuts = np.flatnonzero((np.diff(rows.run) != 0) | restarted) + 1
    for a, b in pairwise([0, *cuts.tolist(), rows.t.size]):
        if b - a > 1:
            yield rows.where(slice(a, b))


def is_old(rows: AppletRows) -> bool:
    """True when the rows are from the old applet, which logged no states."""
    return set(np.unique(rows.state)) <= {OLD_STATE}


def starts(log: Log) -> list[float]:
    """Times [s] of the applet's messages that a run on the steering starts."""
    return [t for t, text in log.marks if START.match(text)]


def announced_kind(log: Log, start: float) -> Kind | None:
    """The kind that the applet announced for the run from `start` [s]; None if only the wave shows it."""
    announced = [text for t, text in log.marks if t <= start + 1.0 and (START.match(text) or END.match(text))]
    return next(
        (kind for name, kind in ANNOUNCED_KINDS.items() if announced and announced[-1].endswith(name)), None
    )


def stop_reason(log: Log, at: float) -> str:
    """The applet's message when it stopped a run at a time [s]."""
    said = (text for t, text in log.marks if abs(t - at) < 1.0 and END.match(text))
    return printable(next(said, "reason not logged"))


def ends(log: Log) -> list[float]:
    """Times [s] of the applet's messages that a run is done or stopped."""
    return [t for t, text in log.marks if END.match(text)]


# The identity of the vehicle that made a log.

# ArduPilot's banner ends with the board's name and its processor's unique id (source: AP_HAL
# Util::get_system_id, "CubeOrange 0028001F 3432510D 37343231"); the simulation has none.
BOARD = re.compile(r"^(\S+ (?:[0-9A-F]{8} ){2}[0-9A-F]{8})$")
SYSTEM = ("MAV_SYSID", "SYSID_THISMAV")  # after 4.6, before
OF_BOARD = (
    "INS_GYR_ID",
    "INS_ACC_ID",
    "COMPASS_DEV_ID",
    "INS_ACCSCAL_X",
    "INS_ACCSCAL_Y",
    "AHRS_ORIENTATION",
)


def identity(log: Log) -> dict[str, str]:
    """{"board", "system id" or parameter: value}, as far as logged."""
    boards = [board.group(1) for _, text in log.marks if (board := BOARD.match(text))]
    found = {"board": boards[-1]} if boards else {}
    system = next((log.parameters[name] for name in SYSTEM if name in log.parameters), log.system)
    if system:
        found["system id"] = f"{system:g}"
    n = output_channel(log.parameters, STEERING) or 1
    names = (*OF_BOARD, *(f"SERVO{n}_{end}" for end in ("TRIM", "MIN", "MAX", "REVERSED")))
    return found | {name: f"{log.parameters[name]:.6g}" for name in names if name in log.parameters}


# Finds the throttle sweeps of a log by the applet's SWET messages.


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
    stops = rows.t[(rows.state == STOPPED) & (rows.t >= end)]
    kept = start - 1.0, end + COASTING
    return ThrottleRun(
        name=f"{log.name} run {rows.run[0]:.0f}" if count > 1 else log.name,
        pwm=pwm.between(*kept),
        speed=log.signals["speed"].between(*kept),
        span=(start, end),
        swept=(log.parameters.get("SWP_WMIN", 0.2), log.parameters.get("SWP_WMAX", 8.0)),
        parameters=log.parameters,
        stopped=stop_reason(log, float(stops[0])) if stops.size else "",
        firmware=log.firmware,
        sources=log.sources,
    )
