"""Time histories of a run."""

from __future__ import annotations

import numpy as np

from rover_sweep.data.recording import Recording
from rover_sweep.report.charts.chart import Chart, Curve, Panel, Stack
from rover_sweep.report.charts.colours import CHANNEL_WORDS, DATA, OUTSIDE, QUIET
from rover_sweep.report.wording.shown_units import SI, ShownUnits

MARGIN = 4.0  # s shown before and after the manoeuvre
DEGREES = ("delta", "r", "p")


def run_chart(run: Recording, units: ShownUnits = SI) -> Chart:
    """Steering, yaw rate, lateral acceleration, roll rate and speed over time since the manoeuvre began."""
    start, end = run.span
    names = [c for c in ("pwm", "delta", "r", "ay", "p", "speed") if c in run]
    panels = tuple(_panel(run, name, units) for name in names)
    length = end - start
    quiet = [(a - start, b - start, QUIET) for a, b in (*run.standstill, *run.straight)]
    outside = [(-MARGIN, 0.0, OUTSIDE), (length, length + MARGIN, OUTSIDE)]
    title = f"{run.name}: {run.kind}, mean speed {run.mean_speed:.2f} m/s"
    span = (-MARGIN, length + MARGIN)
    shades = (
        *outside,
        *((max(a, span[0]), min(b, span[1]), c) for a, b, c in quiet if a < span[1] and b > span[0]),
    )
    return Chart((Stack(title, "time since start of the manoeuvre, s", panels, span, shades=shades),))


def _panel(run: Recording, name: str, units: ShownUnits) -> Panel:
    start, end = run.span
    factor = 180 / np.pi if name in DEGREES else units.factor(run[name].unit)
    shown = run[name].between(start - MARGIN, end + MARGIN)
    inside = run.manoeuvre(name).x
    x = (inside if inside.size else shown.x) * factor
    spare = 0.12 * (float(np.ptp(x)) or 1.0)  # limits of the manoeuvre: start and stop do not compress it
    line = Curve(CHANNEL_WORDS[name].partition(",")[0], shown.x * factor, DATA, width=1.0, step=shown.hold)
    limits = float(x.min()) - spare, float(x.max()) + spare
    return Panel(units.words(CHANNEL_WORDS[name]), shown.t - start, (line,), limits=limits, height=84)
