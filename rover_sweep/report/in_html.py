"""A document as one self-contained HTML page: no network, no other file."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from rover_sweep.files.documents import printable_lines
from rover_sweep.report.charts.static_svg import (
    ShownChart,
    page_script,
    page_styles,
    shown_chart,
    view_script,
)
from rover_sweep.report.document import ON_PAGE, Document, charts_of, shown

Charts = Mapping[str, ShownChart]
Progress = Callable[[float, str], None]


def made_charts(document: Document, progress: Progress | None = None) -> dict[str, ShownChart]:
    """{name: chart} of a page. progress: called with the share done, 0..1, and the step."""
    plans = list(charts_of((*document.answer, *document.sections)))
    made: dict[str, ShownChart] = {}
    for k, plan in enumerate(plans):
        if progress:
            progress(k / len(plans), f"drawing {plan.name}")
        made[plan.name] = shown_chart(plan)
    return made


def in_html(document: Document, charts: Charts | None = None) -> str:
    """The whole page. charts: those of `made_charts`, if they are made already."""
    made = made_charts(document) if charts is None else charts
    template = templates().get_template("document.html.j2")
    return template.render(d=document, charts=made, scripted=any(c.data for c in made.values()))


@cache
def templates() -> Environment:
    """The HTML templates, with escaping."""
    made = Environment(
        loader=PackageLoader("rover_sweep", "report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=_printable,
    )
    made.filters["kind"] = lambda part: type(part).__name__
    made.filters["on_page"] = lambda parts: list(shown(parts, ON_PAGE))
    made.globals["page_script"] = lambda: Markup(page_script())
    made.globals["view_script"] = lambda: Markup(view_script())
    made.globals["page_styles"] = lambda: Markup(page_styles())
    return made


def _printable(value: Any) -> Any:
    """Makes control characters in names and vehicle texts visible."""
    return printable_lines(value) if type(value) is str else value
