"""`Recording.plot` and `Runs.plot`: the channels over time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rover_sweep.data.recording import Recording
from rover_sweep.drawing.axes import panels
from rover_sweep.errors import UsageError
from rover_sweep.report.pictures.history import DEG, MARGIN, ROWS, draw_channel
from rover_sweep.report.pictures.style import WIDTH, literal

STEERING = (("pwm", "steering\nPWM, µs", 1.0), ("delta", "road-wheel\nangle, deg", DEG))
MORE = (
    ("phi", "roll angle\ndeg", DEG),
    ("psi", "heading\ndeg", DEG),
    ("vy", "lateral\nspeed, m/s", 1.0),
    ("throttle", "throttle\nPWM, µs", 1.0),
)
LABELLED = {row[0]: row for row in (*STEERING, *ROWS, *MORE)}
ROW = 1.35  # in


def draw_run(run: Recording, channels: Sequence[str] | None, axes: Any) -> Any:
    """Axes (n,) of the channels of one run over the time since its manoeuvre began."""
    rows = _rows(run, channels)
    with panels(
        axes, (len(rows), 1), [r[0] for r in rows], (WIDTH, 0.9 + ROW * len(rows)), sharex=True
    ) as found:
        _column(found[:, 0], run, rows)
    return found[:, 0]


def draw_runs(runs: Sequence[Recording], channels: Sequence[str] | None, axes: Any) -> Any:
    """Axes (channels, runs): a column for each run. UsageError without a run."""
    if not runs:
        raise UsageError("there is no run to draw")
    rows = [_rows(run, channels or _common(runs)) for run in runs]
    names = [f"{row[0]} of {run.name}" for row in rows[0] for run in runs]
    shape, size = (len(rows[0]), len(runs)), (max(WIDTH, 4.2 * len(runs)), 0.9 + ROW * len(rows[0]))
    with panels(axes, shape, names, size, sharex="col") as found:
        for k, run in enumerate(runs):
            _column(found[:, k], run, rows[k], labelled=k == 0)
    return found


def _common(runs: Sequence[Recording]) -> list[str]:
    """The channels drawn of the first run that all runs have."""
    first = [row[0] for row in _rows(runs[0], None)]
    return [c for c in first if all(c in run for run in runs)]


def _rows(run: Recording, channels: Sequence[str] | None) -> list[tuple[str, str, float]]:
    """(channel, label, factor) of those asked for; by default the steering and the motion."""
    if channels is None:
        steering = next((row for row in STEERING if row[0] in run), None)
        return [row for row in (steering, *ROWS) if row is not None and row[0] in run]
    wanted = (channels,) if isinstance(channels, str) else tuple(channels)
    if not wanted:
        raise UsageError(f"no channel is named; choose from {', '.join(run.channels)}")
    if missing := [c for c in wanted if c not in run]:
        raise UsageError(f"{run.name} has no channel {missing[0]!r}; it has {', '.join(run.channels)}")
    return [LABELLED.get(c, (c, f"{c}\n{run[c].unit}", 1.0)) for c in wanted]


def _column(
    column: Any, run: Recording, rows: Sequence[tuple[str, str, float]], labelled: bool = True
) -> None:
    for one, row in zip(column, rows, strict=True):
        draw_channel(one, run, *row)
        one.yaxis.set_label_coords(-0.075, 0.5)
        if not labelled:
            one.set_ylabel("")
    speed = f", mean speed {run.mean_speed:.2f} m/s" if "speed" in run else ""
    column[0].set_title(f"{literal(run.name)}: {run.kind}{speed}")
    column[-1].set_xlim(-MARGIN, run.span[1] - run.span[0] + MARGIN)
    column[-1].set_xlabel("time since start of the manoeuvre, s")
