"""The quantities of a vehicle against the date."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import date, timedelta
from functools import partial

import matplotlib.dates as dates
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rover_sweep.report.charts.embedded import chart_json
from rover_sweep.report.charts.season_chart import changed_first, season_chart
from rover_sweep.report.charts.shown_chart import ShownChart, png_source
from rover_sweep.report.pictures.picture import Picture
from rover_sweep.report.pictures.style import BAND, DATA, WIDTH
from rover_sweep.season.season_result import Drift, TrackedQuantity, VehicleSeason

CAPTION = (
    "Each day with its 90 % interval (of differences between days). Line: the course that the season shows; "
    "orange: a change. Quantities with a change first."
)
COLUMNS = 3


def shown_courses(vehicle: VehicleSeason) -> tuple[ShownChart, ...]:
    """One picture with all quantities, as drawn by matplotlib and as data of the interactive chart."""
    if not vehicle.quantities:
        return ()
    shown = vehicle.quantities, vehicle.drifts
    picture = Picture("courses", "courses", CAPTION, partial(courses, *shown))
    data = chart_json(season_chart(*shown))
    return (ShownChart("courses", CAPTION, source=png_source(picture.png()), data=data),)


def courses(quantities: Sequence[TrackedQuantity], drifts: Sequence[Drift]) -> Figure:
    """Small pictures of the quantities, the changed ones first."""
    ordered, changed = changed_first(quantities, drifts)
    rows = -(-len(ordered) // COLUMNS)
    figure = Figure(figsize=(WIDTH, 0.6 + 1.75 * rows))
    grid = figure.subplots(rows, COLUMNS, squeeze=False).ravel()
    height = figure.get_figheight()
    figure.subplots_adjust(
        left=0.07, right=0.985, top=1 - 0.3 / height, bottom=0.35 / height, hspace=0.62, wspace=0.3
    )
    for axes, q in zip(grid, ordered, strict=False):
        _course(axes, q, changed.get(q.name))
    for axes in grid[len(ordered) :]:
        axes.set_visible(False)
    return figure


def _course(axes: Axes, q: TrackedQuantity, drift: Drift | None) -> None:
    t = np.array([dates.date2num(date.fromisoformat(d.day)) for d in q.days])
    value, low, high, fitted = (
        np.array([getattr(d, name) for d in q.days]) for name in ("value", "low", "high", "fitted")
    )
    axes.errorbar(t, value, (value - low, high - value), fmt="o", ms=3, color=DATA, elinewidth=0.9)
    step = drift is not None and drift.kind == "step"
    axes.plot(
        t, fitted, color=BAND if drift else DATA, linewidth=1.1, drawstyle="steps-mid" if step else "default"
    )
    if drift is not None:
        axes.axvspan(*_shaded(drift), color=BAND, alpha=0.25, linewidth=0)
    shown = f", {q.unit}" if q.unit and "vehicle file" not in q.unit else ""
    axes.set_title(f"{q.name}{shown}", fontweight="bold" if drift else "normal")
    axes.xaxis.set_major_locator(dates.AutoDateLocator(minticks=2, maxticks=5))
    axes.xaxis.set_major_formatter(dates.DateFormatter("%d %b"))
    axes.tick_params(labelsize=8)


def _shaded(drift: Drift) -> tuple[float, float]:
    first, last = (date.fromisoformat(day) for day in (drift.earliest, drift.latest))
    return float(dates.date2num(first - timedelta(days=1))), float(dates.date2num(last + timedelta(days=1)))
