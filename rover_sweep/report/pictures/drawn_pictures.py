"""Pictures drawn by matplotlib, with the data of the interactive charts where they have some."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from rover_sweep.report.charts.embedded import chart_json
from rover_sweep.report.charts.shown_chart import ShownChart, png_source
from rover_sweep.report.pictures.drawing_processes import pngs
from rover_sweep.report.pictures.picture import Picture


def drawn_pictures(
    plan: Sequence[Picture], progress: Callable[[float, str], None] | None = None
) -> tuple[ShownChart, ...]:
    """All pictures, drawn on all processors. progress: called with the share done, 0..1, and the step."""
    shown = []
    made = pngs(plan)
    for k, picture in enumerate(plan):
        if progress:
            progress(k / len(plan), f"drawing {picture.name}")
        data = chart_json(picture.chart()) if picture.chart else ""
        shown.append(ShownChart(picture.section, picture.caption, source=png_source(next(made)), data=data))
    return tuple(shown)
