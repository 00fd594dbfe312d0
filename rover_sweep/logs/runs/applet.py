"""What the applet writes into a log: its states run by run, and its messages."""

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
TOLD_KINDS: Mapping[str, Kind] = {"start multisine": "multisine", "start bias sweep": "bias_sweep"}
START = re.compile(r"^SW[PX]\b.*\bstart\b", re.IGNORECASE)
END = re.compile(r"^SW[PX]\b.*\b(done|stop|stopped|abort|aborted)\b", re.IGNORECASE)


def applet_runs(rows: AppletRows) -> Iterator[AppletRows]:
    """The applet's rows run by run; the old applet's clock T restarts with each run."""
    rows = _without_lone(rows)
    old = (rows.state == OLD_STATE) & (rows.clock >= 0)
    restarted = old[1:] & old[:-1] & (np.diff(rows.clock) < -0.5)
    cuts = np.flatnonzero((np.diff(rows.run) != 0) | restarted) + 1
    for a, b in pairwise([0, *cuts.tolist(), rows.t.size]):
        if b - a > 1:
            yield AppletRows(rows.t[a:b], rows.run[a:b], rows.state[a:b], rows.clock[a:b])


def _without_lone(rows: AppletRows) -> AppletRows:
    """Without rows whose run or state is another than that of both neighbours, which agree: damage."""
    keep = np.ones(rows.t.size, bool)
    for x in (rows.run, rows.state):
        keep[1:-1] &= (x[1:-1] == x[:-2]) | (x[:-2] != x[2:])
    return AppletRows(rows.t[keep], rows.run[keep], rows.state[keep], rows.clock[keep])


def is_old(rows: AppletRows) -> bool:
    """Whether the rows of a run come from the applet that logged no states."""
    return set(np.unique(rows.state)) <= {OLD_STATE}


def starts(log: Log) -> list[float]:
    """Times [s] of the applet's messages that a run starts."""
    return [t for t, text in log.marks if START.match(text)]


def told_kind(log: Log, start: float) -> Kind | None:
    """What the applet called the run that is excited from `start` [s]; None where its wave must tell."""
    said = [text for t, text in log.marks if t <= start + 1.0 and (START.match(text) or END.match(text))]
    return next((kind for name, kind in TOLD_KINDS.items() if said and said[-1].endswith(name)), None)


def ends(log: Log) -> list[float]:
    """Times [s] of its messages that a run is done, or stopped."""
    return [t for t, text in log.marks if END.match(text)]
