"""All candidates' scores as a bar chart."""

from __future__ import annotations

import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from rover_sweep.diagnosis.result import Diagnosis
from rover_sweep.report.pictures.style import WIDTH

LEAST = 1.0  # smallest reduction of chi-squared shown
NAMED, ALIKE, OTHER = "#D55E00", "#56B4E9", "#BDBDBD"


def scores(found: Diagnosis) -> Figure:
    """Reduction of chi-squared by each candidate alone, largest on top; findings marked."""
    known = {e: float(s) if np.isfinite(s) else 0.0 for e, s in found.scores.items()}
    order = sorted(known, key=lambda e: known[e])
    named = {f.effect for f in found.findings}
    alike = {e for f in found.findings for e in f.look_alikes} - named
    values = [max(known[e], 0.0) for e in order]
    height = 0.75 + 0.235 * len(order)
    figure = Figure(figsize=(WIDTH, height))
    axes = figure.add_axes((0.19, 0.5 / height, 0.79, 1 - 0.58 / height))
    bars = axes.barh(range(len(order)), [max(v, LEAST) for v in values], height=0.68)
    for bar, effect in zip(bars, order, strict=True):
        bar.set_facecolor(NAMED if effect in named else ALIKE if effect in alike else OTHER)
        bar.set_hatch("//" if effect in alike else None)
        bar.set_edgecolor("white")
    axes.set_yticks(range(len(order)), order)
    axes.set_ylim(-0.6, len(order) - 0.4)
    axes.grid(axis="y", visible=False)
    top = max(values, default=0.0)
    axes.set_xscale("log")  # true effects are 10 to 1000 times above chance
    axes.set_xlim(LEAST, max(4 * top, 100.0))
    for k, value in enumerate(values):
        axes.text(1.08 * max(value, LEAST), k, _gain(value), va="center", fontsize=8.5)
    axes.set_xlabel("reduction of chi-squared")
    keys: list[Artist] = [Patch(facecolor=NAMED, label="named")] if named else []
    keys += [Patch(facecolor=ALIKE, hatch="//", edgecolor="white", label="look-alike")] if alike else []
    keys += [Patch(facecolor=OTHER, label="other")] if keys else []
    if keys:
        axes.legend(handles=keys, loc="lower right")
    return figure


def _gain(value: float) -> str:
    """The number with a space between thousands; below 1000 with three digits."""
    return f"{value:,.0f}".replace(",", "\N{NARROW NO-BREAK SPACE}") if value >= 1000 else f"{value:.3g}"
