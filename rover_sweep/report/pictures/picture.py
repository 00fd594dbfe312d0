"""A picture drawn by matplotlib, and the same data as an interactive chart."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from matplotlib.figure import Figure

from rover_sweep.report.charts.chart import Chart
from rover_sweep.report.pictures.style import png, styled


@dataclass(frozen=True, eq=False)
class Picture:
    """A matplotlib picture of a report. name: of its file, without .png; section: of its page; make: its
    figure; chart: the same data for the interactive page, None for a picture that is only static."""

    name: str
    section: str
    caption: str
    make: Callable[[], Figure]
    chart: Callable[[], Chart] | None = None

    def figure(self) -> Figure:
        """The figure, in the report's style."""
        with styled():
            return self.make()

    def png(self) -> bytes:
        """The figure as PNG bytes."""
        with styled():
            return png(self.make())
