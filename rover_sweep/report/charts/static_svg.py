"""A chart as SVG text, written directly: for print, for slides, and for a page without JavaScript."""

from __future__ import annotations

import base64
import json
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from textwrap import wrap
from typing import Any
from xml.sax.saxutils import escape, quoteattr

import numpy as np
from markupsafe import Markup

from rover_sweep.data.recording import Array
from rover_sweep.files.documents import printable
from rover_sweep.report.charts.chart import (
    Chart,
    ChartPlan,
    Curve,
    Panel,
    Spread,
    Stack,
    kept_points,
    shown_limits,
    ticks,
)

POINTS = 1000  # of a line or an area, about one for each px
LEFT, RIGHT, TITLE, KEY, FOOT, GAP = 58, 8, 22, 18, 31, 22  # px around the panels of a stack
BOLD = 7.0  # px of a character of a title, on average
LINE = 16  # px from one line of a title to the next
TITLED = ' font-weight="600" fill="#111"'
SOFT, GRID = "#555555", "#dddddd"


def svg(chart: Chart) -> str:
    """The whole chart. The same chart gives the same text."""
    width = (chart.width - 20 * (chart.columns - 1)) / chart.columns
    out, top = [], 0.0
    for k in range(0, len(chart.stacks), chart.columns):
        row = chart.stacks[k : k + chart.columns]
        titles = [_title_lines(stack.title, int((width - LEFT) / BOLD)) for stack in row]
        lower = LINE * (max(len(lines) for lines in titles) - 1)
        for i, stack in enumerate(row):
            texts = (_text(LEFT, 14 + LINE * n, t, TITLED) for n, t in enumerate(titles[i]))
            drawn = f'<g transform="translate(0 {lower})">{"".join(_stack(stack, width))}</g>'
            place = f"translate({i * (width + 20):.0f} {top:.0f})"
            out.append(f'<g transform="{place}">{"".join(texts)}{drawn}</g>')
        top += lower + max(sum(p.height + GAP for p in s.panels) for s in row) + TITLE + KEY + FOOT + 8
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {chart.width} {top:.0f}" '
        f'font-family="system-ui, Arial, sans-serif" font-size="12" fill="none">'
        f'<rect width="{chart.width}" height="{top:.0f}" fill="#fff"/>{"".join(out)}</svg>'
    )


def _title_lines(title: str, room: int) -> list[str]:
    """The title in lines of at most `room` characters, broken after a semicolon where there is one."""
    parts = [title] if len(title) <= room else title.split("; ")
    return [line for part in parts for line in wrap(part, room, break_on_hyphens=False) or [""]]


def _stack(stack: Stack, width: float) -> Iterator[str]:
    yield from _key(stack, width)
    top = TITLE + KEY
    for panel in stack.panels:
        yield from _panel(stack, panel, (LEFT, top, width - LEFT - RIGHT))
        top += panel.height + GAP
    middle = LEFT + (width - LEFT - RIGHT) / 2
    yield _text(middle, top + 13, stack.x_label, f' text-anchor="middle" fill="{SOFT}"')


def _key(stack: Stack, width: float) -> Iterator[str]:
    """The legend: each label once, as far as there is room."""
    found: dict[str, Curve | Spread] = {}
    for panel in stack.panels:
        items: list[Curve | Spread] = [*panel.lines, *panel.spreads]
        for item in items:
            found.setdefault(item.label, item)
    x = float(LEFT)
    for label, item in found.items() if len(found) > 1 else ():
        long = 26 + 6.3 * len(label)
        if x + long > width:
            return
        mark = f'stroke="{item.colour}" stroke-width="{"9" if isinstance(item, Spread) else "2"}"'
        dash = _dash(item) if isinstance(item, Curve) else ""
        yield f'<path d="M{x:.0f} 27h18" {mark}{dash}/>'
        yield _text(x + 22, 31, label, f' fill="{SOFT}" font-size="11"')
        x += long + 8


def _panel(stack: Stack, panel: Panel, box: tuple[float, float, float]) -> Iterator[str]:
    left, top, width = box
    low, high = shown_limits(panel)
    bottom = top + panel.height

    def across(x: Array) -> Array:
        a, b = stack.span
        if stack.kind == "log":
            x, a, b = np.log(np.maximum(x, 1e-9)), np.log(a), np.log(b)
        return left + (np.clip(x, a - (b - a), b + (b - a)) - a) / (b - a) * width

    def down(y: Array) -> Array:
        share = (np.clip(y, low - (high - low), high + (high - low)) - low) / (high - low)
        return bottom - share * panel.height

    frame = f"{left} {top} {width:.0f} {panel.height}"
    yield f'<svg x="{left}" y="{top}" width="{width:.0f}" height="{panel.height}" viewBox="{frame}">'
    for a, b, colour in stack.shades:
        x0, x1 = np.clip(across(np.array([a, b])), left, left + width)
        size = f'width="{max(x1 - x0, 0):.1f}" height="{panel.height}"'
        yield f'<rect x="{x0:.1f}" y="{top}" {size} fill="{colour}"/>'

    def flat(y: float, style: str) -> str:
        return f'<path d="M{left} {down(np.array(y)):.1f}h{width:.0f}" {style}/>'

    def upright(x: float, style: str) -> str:
        return f'<path d="M{across(np.array(x)):.1f} {top}v{panel.height}" {style}/>'

    grid = f'stroke="{GRID}" stroke-width=".7"'
    across_ticks = list(enumerate(stack.labels)) or ticks(*stack.span, stack.kind)
    up_ticks = ticks(low, high, most=5)
    yield from (flat(value, grid) for value, _ in up_ticks)
    yield from (upright(value, grid) for value, _ in across_ticks)
    yield from (upright(mark, f'stroke="{colour}" stroke-width="1.2"') for mark, colour in stack.marks)
    yield from (flat(level, 'stroke="#777" stroke-dasharray="4 3"') for level in panel.levels)
    for s in panel.spreads:
        yield from _area(across(panel.x), down(s.low), down(s.high), s.colour)
    floor = float(down(np.array(0.0)))
    yield from (_line(across(panel.x), down(line.y), line, width, floor) for line in panel.lines)
    yield "</svg>"
    yield f'<path d="M{left} {top}v{panel.height}h{width:.0f}" stroke="#888"/>'
    small = f' fill="{SOFT}" font-size="11"'
    for value, label in up_ticks:
        yield _text(left - 4, float(down(np.array(value))) + 4, label, f' text-anchor="end"{small}')
    for value, label in across_ticks:
        yield _text(float(across(np.array(value))), bottom + 14, label, f' text-anchor="middle"{small}')
    middle = top + panel.height / 2
    yield _text(
        11, middle, panel.label, f' transform="rotate(-90 11 {middle:.0f})" text-anchor="middle"{small}'
    )


def _area(x: Array, low: Array, high: Array, colour: str) -> Iterator[str]:
    known = np.isfinite(low) & np.isfinite(high)
    if not known.any():
        return
    x, low, high = x[known], low[known], high[known]
    kept = kept_points([low, high], POINTS)
    points = _points(np.concatenate((x[kept], x[kept][::-1])), np.concatenate((low[kept], high[kept][::-1])))
    yield f'<path d="M{points}z" fill="{colour}" fill-opacity=".75"/>'


def _line(x: Array, y: Array, line: Curve, width: float, floor: float) -> str:
    """The path of a line, of dots, or of bars from y = floor [px]."""
    kept = kept_points([y], int(1.5 * width))
    x, y = x[kept], y[kept]
    if line.bars:
        known = np.isfinite(y)
        bars = "".join(f"M{a:.1f} {floor:.1f}V{b:.1f}" for a, b in zip(x[known], y[known], strict=True))
        return f'<path d="{bars}" stroke="{line.colour}" stroke-width="{0.5 * width / max(x.size, 2):.0f}"/>'
    if line.dots:
        known = np.isfinite(y)
        dots = "".join(f"M{a:.1f} {b:.1f}h0" for a, b in zip(x[known], y[known], strict=True))
        return f'<path d="{dots}" stroke="{line.colour}" stroke-width="4.5" stroke-linecap="round"/>'
    if line.step and x.size:
        x, y = np.repeat(x, 2)[1:], np.repeat(y, 2)[:-1]
    pieces = np.split(np.arange(x.size), np.flatnonzero(~np.isfinite(y)))
    parts = [p[np.isfinite(y[p])] for p in pieces]
    path = "".join(f"M{_points(x[p], y[p])}" for p in parts if p.size > 1)
    return f'<path d="{path}" stroke="{line.colour}" stroke-width="{line.width}"{_dash(line)}/>'


def _points(x: Array, y: Array) -> str:
    return " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x.tolist(), y.tolist(), strict=True))


def _dash(line: Curve) -> str:
    return f' stroke-dasharray="{" ".join(f"{d:g}" for d in line.dash)}"' if line.dash else ""


def _text(x: float, y: float, text: str, more: str) -> str:
    return f"<text x={quoteattr(f'{x:.0f}')} y={quoteattr(f'{y:.0f}')}{more}>{escape(printable(text))}</text>"


# A chart as JSON in the page, and the script that draws it there.


VALUES, LEAST = 7200, 1200  # numbers of a panel, and its least points; every peak of a longer run stays
UPLOT = "uplot-1.6.32"


def chart_json(chart: Chart) -> str:
    """The chart's data for the script of the page; safe inside of a script element."""
    return in_script({"columns": chart.columns, "stacks": [_uplot_stack(s) for s in chart.stacks]})


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
    return (files("rover_sweep.report.charts") / "view_log.js").read_text(encoding="utf-8")


@cache
def page_styles() -> str:
    """The styles of uPlot and of the charts."""
    here = files("rover_sweep.report.charts")
    parts = (here / UPLOT / "uPlot.min.css", here / "charts.css")
    return "\n".join(part.read_text(encoding="utf-8") for part in parts)


def _uplot_stack(stack: Stack) -> dict[str, Any]:
    return {
        "title": printable(stack.title),
        "xLabel": printable(stack.x_label),
        "kind": stack.kind,
        "labels": [printable(label) for label in stack.labels],
        "span": stack.span,
        "shades": stack.shades,
        "marks": stack.marks,
        "panels": [_uplot_panel(p, "<f8" if stack.kind == "date" else "<f4") for p in stack.panels],
    }


def _uplot_panel(panel: Panel, kind: str) -> dict[str, Any]:
    most = max(LEAST, VALUES // (1 + len(panel.lines)))
    kept = kept_points([item.y for item in panel.lines], most)
    return {
        "label": printable(panel.label),
        "height": panel.height,
        "limits": shown_limits(panel),
        "levels": panel.levels,
        "bytes": int(kind[-1]),
        "x": packed(panel.x[kept], kind),
        "spreads": [
            {"label": s.label, "low": packed(s.low[kept]), "high": packed(s.high[kept]), "colour": s.colour}
            for s in panel.spreads
        ],
        "lines": [
            vars(item) | {"label": printable(item.label), "y": packed(item.y[kept])} for item in panel.lines
        ],
    }


# The charts of a page in both forms: static, and data for the interactive chart.


@dataclass(frozen=True)
class ShownChart:
    """A chart of a page. svg: its static form, every text in it escaped; data: JSON that ends no element, ""
    for none."""

    caption: str
    svg: Markup
    data: Markup = Markup()


def shown_chart(plan: ChartPlan) -> ShownChart:
    """A chart with its static SVG."""
    chart = plan.make()
    data = Markup(chart_json(chart)) if plan.interactive else Markup()
    return ShownChart(plan.caption, Markup(svg(chart)), data)
