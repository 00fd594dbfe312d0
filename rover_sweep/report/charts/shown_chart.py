"""The pictures of a page in both forms: static (SVG or PNG), and data for the interactive chart."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass

from markupsafe import Markup

from rover_sweep.report.charts.chart import ChartPlan
from rover_sweep.report.charts.embedded import chart_json
from rover_sweep.report.charts.static_svg import svg


@dataclass(frozen=True)
class ShownChart:
    """A picture of a page. svg or source (a data URL of a PNG): the static form; data: JSON, "" for none."""

    section: str
    caption: str
    svg: str = ""
    source: str = ""
    data: str = ""

    @property
    def static(self) -> Markup:
        """The SVG as markup: `static_svg` escapes every text in it."""
        return Markup(self.svg)

    @property
    def script(self) -> Markup:
        """The JSON as markup: `in_script` leaves nothing that could end its element."""
        return Markup(self.data)


def shown_chart(plan: ChartPlan) -> ShownChart:
    """A chart with its static SVG."""
    chart = plan.make()
    return ShownChart(plan.section, plan.caption, svg(chart), data=chart_json(chart))


def png_source(png: bytes) -> str:
    """A PNG as a data URL."""
    return "data:image/png;base64," + base64.b64encode(png).decode("ascii")


def by_section(pictures: Sequence[ShownChart]) -> dict[str, list[ShownChart]]:
    """{section: its pictures}, for `figures` of page_parts.html.j2."""
    sections: dict[str, list[ShownChart]] = {}
    for picture in pictures:
        sections.setdefault(picture.section, []).append(picture)
    return sections
