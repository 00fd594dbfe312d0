"""Time history of a run: steering and motion, as Figure 2 of the paper."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rover_sweep.data.recording import Recording, Signal
from rover_sweep.report.pictures.style import DATA, OUTSIDE, QUIET, WIDTH, literal

MARGIN = 4.0  # s shown before and after the manoeuvre
DEG = 180 / np.pi
ROWS = (
    ("r", "yaw rate r\ndeg/s", DEG),
    ("ay", "lateral acc. $a_y$\nm/s²", 1.0),
    ("p", "roll rate p\ndeg/s", DEG),
    ("speed", "speed V\nm/s", 1.0),
)


def history(run: Recording) -> Figure:
    """Steering, yaw rate, lateral acceleration, roll rate and speed over time since the manoeuvre began."""
    rows = [("pwm", "steering\nPWM, µs", 1.0)] if "pwm" in run else [("delta", "road-wheel\nangle, deg", DEG)]
    rows += [row for row in ROWS if row[0] in run]
    figure = Figure(figsize=(WIDTH, 1.0 + 1.35 * len(rows)))
    grid = figure.subplots(len(rows), 1, sharex=True, squeeze=False)[:, 0]
    figure.subplots_adjust(
        left=0.095,
        right=0.91,
        top=1 - 0.32 / figure.get_figheight(),
        bottom=0.52 / figure.get_figheight(),
        hspace=0.14,
    )
    for axes, row in zip(grid, rows, strict=True):
        draw_channel(axes, run, *row)
    _angle_axis(grid[0], run)
    start, end = run.span
    grid[-1].set_xlim(-MARGIN, end - start + MARGIN)
    grid[-1].set_xlabel("time since start of the manoeuvre, s")
    grid[0].set_title(f"{literal(run.name)}: {run.kind}, mean speed {run.mean_speed:.2f} m/s")
    return figure


def draw_channel(axes: Axes, run: Recording, channel: str, label: str, factor: float) -> None:
    """One channel times a factor over time, with its surroundings shaded and the quiet intervals marked."""
    start, end = run.span
    shown = run[channel].between(start - MARGIN, end + MARGIN)
    axes.plot(
        shown.t - start,
        shown.x * factor,
        color=DATA,
        linewidth=0.9,
        drawstyle="steps-post" if shown.hold else "default",
    )
    axes.set_ylabel(label)
    axes.yaxis.set_label_coords(-0.055, 0.5)
    _scale(axes, shown, run.manoeuvre(channel), factor)
    for a, b in ((-MARGIN, 0.0), (end - start, end - start + MARGIN)):
        axes.axvspan(a, b, color=OUTSIDE, linewidth=0)
    for a, b in (*run.standstill, *run.straight):
        low, high = max(a - start, -MARGIN), min(b - start, end - start + MARGIN)
        if high > low:
            axes.axvspan(low, high, ymax=0.05, color=QUIET, linewidth=0)


def _scale(axes: Axes, shown: Signal, inside: Signal, factor: float) -> None:
    """Axis limits from the manoeuvre only, so that the start and stop do not compress it."""
    x = inside.x * factor if inside.x.size else shown.x * factor
    spare = 0.12 * (float(np.ptp(x)) or 1.0)
    axes.set_ylim(float(x.min()) - spare, float(x.max()) + spare)


def _angle_axis(axes: Axes, run: Recording) -> None:
    """Right axis with the road-wheel angle, if it was computed from the PWM."""
    if "pwm" not in run or "delta" not in run:
        return
    pwm, delta = run["pwm"].x, run["delta"].x
    if pwm.size != delta.size or np.ptp(pwm) == 0:
        return
    slope, offset = np.polyfit(pwm, delta * DEG, 1)
    right = axes.secondary_yaxis(
        "right", functions=(lambda u: u * slope + offset, lambda d: (d - offset) / slope)
    )
    right.set_ylabel("angle, deg\nleft positive")
