"""A chart as JSON in the page, and the script that draws it there."""

from __future__ import annotations

import base64
import json
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.files.printable import printable
from rover_sweep.report.charts.chart import Chart, Panel, Stack
from rover_sweep.report.charts.static_svg import shown_limits
from rover_sweep.report.charts.thinned import kept_points

VALUES, LEAST = 7200, 1200  # numbers of a panel, and its least points; every peak of a longer run stays
UPLOT = "uplot-1.6.32"


def chart_json(chart: Chart) -> str:
    """The chart's data for the script of the page; safe inside of a script element."""
    return in_script({"columns": chart.columns, "stacks": [_stack(s) for s in chart.stacks]})


def in_script(content: Any) -> str:
    """JSON without the characters that could end a script element."""
    text = json.dumps(content, ensure_ascii=False, separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c").replace("&", "\\u0026").replace("\u2028", " ").replace("\u2029", " ")


def packed(values: Array, kind: str = "<f4") -> str:
    """Numbers as base64 of little-endian floats: a third of their decimal text."""
    return base64.b64encode(np.ascontiguousarray(values, dtype=kind).tobytes()).decode("ascii")


@cache
def page_script() -> str:
    """uPlot and the script that builds the charts."""
    here = files("rover_sweep.report.charts")
    parts = (here / UPLOT / "uPlot.iife.min.js", here / "draw_charts.js")
    return "\n".join(part.read_text(encoding="utf-8") for part in parts)


@cache
def view_script() -> str:
    """The script of a log's page."""
    return (files("rover_sweep.report.view") / "view_log.js").read_text(encoding="utf-8")


@cache
def page_styles() -> str:
    """The styles of uPlot and of the charts."""
    here = files("rover_sweep.report.charts")
    parts = (here / UPLOT / "uPlot.min.css", here / "charts.css")
    return "\n".join(part.read_text(encoding="utf-8") for part in parts)


def _stack(stack: Stack) -> dict[str, Any]:
    return {
        "title": printable(stack.title),
        "xLabel": printable(stack.x_label),
        "kind": stack.kind,
        "span": list(stack.span),
        "shades": [list(s) for s in stack.shades],
        "marks": [list(m) for m in stack.marks],
        "panels": [_panel(p, "<f8" if stack.kind == "date" else "<f4") for p in stack.panels],
    }


def _panel(panel: Panel, kind: str) -> dict[str, Any]:
    most = max(LEAST, VALUES // (1 + len(panel.lines)))
    kept = kept_points([item.y for item in panel.lines], most)
    return {
        "label": printable(panel.label),
        "height": panel.height,
        "limits": list(shown_limits(panel)),
        "levels": list(panel.levels),
        "bytes": int(kind[-1]),
        "x": packed(panel.x[kept], kind),
        "spreads": [
            {"label": s.label, "low": packed(s.low[kept]), "high": packed(s.high[kept]), "colour": s.colour}
            for s in panel.spreads
        ],
        "lines": [
            {
                "label": printable(item.label),
                "y": packed(item.y[kept]),
                "colour": item.colour,
                "dash": list(item.dash),
                "width": item.width,
                "step": item.step,
                "dots": item.dots,
            }
            for item in panel.lines
        ],
    }
