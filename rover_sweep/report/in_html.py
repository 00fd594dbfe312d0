"""A document as one self-contained HTML page: no network, no other file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from rover_sweep.data.recording import Signal
from rover_sweep.data.results import Progress
from rover_sweep.files.documents import printable_lines, remove_file, write_file
from rover_sweep.report.charts.chart import kept_points
from rover_sweep.report.charts.static_svg import (
    ShownChart,
    in_script,
    packed,
    page_script,
    page_styles,
    shown_chart,
    view_script,
)
from rover_sweep.report.document import ON_PAGE, Document, charts_of, shown
from rover_sweep.report.wording import versions

Charts = Mapping[str, ShownChart]


def made_charts(document: Document, progress: Progress | None = None) -> dict[str, ShownChart]:
    """{name: chart} of a page. progress: called with the step and the share done, 0..1."""
    plans = list(charts_of((*document.answer, *document.sections)))
    made: dict[str, ShownChart] = {}
    for k, plan in enumerate(plans):
        if progress:
            progress(f"drawing {plan.name}", k / len(plans))
        made[plan.name] = shown_chart(plan)
    return made


def in_html(document: Document, charts: Charts | None = None) -> str:
    """The whole page. charts: those of `made_charts`, if they are made already."""
    made = made_charts(document) if charts is None else charts
    template = templates().get_template("document.html.j2")
    return template.render(d=document, charts=made, scripted=any(c.data for c in made.values()))


@dataclass(frozen=True)
class PageFiles:
    """Paths of a written page for people and of its document for programs."""

    directory: Path
    document: Path
    page: Path


def write_page(directory: Path, stem: str, document: Document, text: str) -> PageFiles:
    """Writes <stem>.html, then <stem>.json with the text, into a folder, which is created if missing.

    The old document is deleted first, so that it is never next to a newer page.
    """
    html = in_html(document)
    path = directory / f"{stem}.json"
    remove_file(path)
    page = write_file(directory / f"{stem}.html", html)
    return PageFiles(directory, write_file(path, text), page)


@cache
def templates() -> Environment:
    """The HTML templates, with escaping."""
    made = Environment(
        loader=PackageLoader("rover_sweep", "report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        # makes control characters in names and vehicle texts visible
        finalize=lambda value: printable_lines(value) if type(value) is str else value,
    )
    filters: dict[str, Any] = {
        "kind": lambda part: type(part).__name__,
        "on_page": lambda parts: list(shown(parts, ON_PAGE)),
    }
    texts: dict[str, Any] = {
        "page_script": lambda: Markup(page_script()),
        "view_script": lambda: Markup(view_script()),
        "page_styles": lambda: Markup(page_styles()),
    }
    made.filters.update(filters)
    made.globals.update(texts)
    return made


# The page of a log: all channels as data, and two selects.


MOST = 200_000  # points of a page: about 2 MB


def log_page(name: str, logs: Sequence[Mapping[str, Signal]]) -> str:
    """HTML of the logs in one file. Long channels are thinned such that every peak stays."""
    signals = {
        (channel if len(logs) == 1 else f"{channel} ({k + 1})"): signal
        for k, log in enumerate(logs)
        for channel, signal in log.items()
        if signal.t.size > 1
    }
    start = min((float(s.t[0]) for s in signals.values()), default=0.0)
    most = MOST // max(len(signals), 1)
    data = {label: _channel(signal, start, most) for label, signal in signals.items()}
    page = templates().get_template("log.html.j2")
    return page.render(name=name, channels=data, data=Markup(in_script(data)), versions=versions())


def _channel(signal: Signal, start: float, most: int) -> dict[str, object]:
    kept = kept_points([signal.x], most)
    factor, unit = (
        (180 / np.pi, signal.unit.replace("rad", "deg")) if "rad" in signal.unit else (1.0, signal.unit)
    )
    return {
        "unit": unit.replace("^2", "²"),
        "source": signal.source,
        "hold": signal.hold,
        "t": packed(signal.t[kept] - start),
        "x": packed(signal.x[kept] * factor),
    }
