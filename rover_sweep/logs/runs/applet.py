"""The applet's states, run by run, and its messages in a log."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from itertools import pairwise

import numpy as np

from rover_sweep.data.recording import Kind
from rover_sweep.logs.log import AppletRows, Log

WAVE_STATES = {4, 5, 6, 7}  # fade-in, dwell, law or doublet, fade-out
OVERRIDE_STATES = {3, 8} | WAVE_STATES
STOPPED = 10
OLD_STATE = 2  # the only state that the applet of 2025 logged
ANNOUNCED_KINDS: Mapping[str, Kind] = {"start multisine": "multisine", "start bias sweep": "bias_sweep"}
START = re.compile(r"^SW[PX]\b.*\bstart\b(?! throttle)", re.IGNORECASE)
END = re.compile(r"^SW[PX]\b.*\b(done|stop|stopped|abort|aborted)\b", re.IGNORECASE)


def applet_runs(rows: AppletRows) -> Iterator[AppletRows]:
    """The applet's rows of each run; the old applet's clock T restarts with each run."""
    rows = _without_lone(rows)
    old = (rows.state == OLD_STATE) & (rows.clock >= 0)
    restarted = old[1:] & old[:-1] & (np.diff(rows.clock) < -0.5)
    cuts = np.flatnonzero((np.diff(rows.run) != 0) | restarted) + 1
    for a, b in pairwise([0, *cuts.tolist(), rows.t.size]):
        if b - a > 1:
            yield AppletRows(rows.t[a:b], rows.run[a:b], rows.state[a:b], rows.clock[a:b])


def _without_lone(rows: AppletRows) -> AppletRows:
    """Without damaged rows, whose run or state differs from both neighbours, which are equal."""
    keep = np.ones(rows.t.size, bool)
    for x in (rows.run, rows.state):
        keep[1:-1] &= (x[1:-1] == x[:-2]) | (x[:-2] != x[2:])
    return AppletRows(rows.t[keep], rows.run[keep], rows.state[keep], rows.clock[keep])


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


def ends(log: Log) -> list[float]:
    """Times [s] of the applet's messages that a run is done or stopped."""
    return [t for t, text in log.marks if END.match(text)]
