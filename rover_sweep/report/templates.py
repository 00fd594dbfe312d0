"""The HTML templates of all reports: one environment with escaping, and shared parts."""

from __future__ import annotations

from functools import cache
from typing import Any

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from rover_sweep.data.results import number
from rover_sweep.files.documents import printable_lines
from rover_sweep.report.charts.static_svg import page_script, page_styles, view_script


@cache
def environment(*folders: str) -> Environment:
    """Templates of these folders of the package, and the parts that all pages share (page_parts.html.j2)."""
    loader = ChoiceLoader([PackageLoader("rover_sweep", folder) for folder in ("report", *folders)])
    templates = Environment(
        loader=loader,
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=_printable,
    )
    templates.filters["number"] = number
    templates.globals["page_script"] = lambda: Markup(page_script())
    templates.globals["view_script"] = lambda: Markup(view_script())
    templates.globals["page_styles"] = lambda: Markup(page_styles())
    return templates


def _printable(value: Any) -> Any:
    """Makes control characters in names and vehicle texts visible."""
    return printable_lines(value) if type(value) is str else value
