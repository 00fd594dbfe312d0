"""Responses of recording and simulation, before and after, over each other."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rover_sweep.comparison.answer import Bode
from rover_sweep.data.recording import Array
from rover_sweep.report.pictures.overlay import AFTER, BEFORE
from rover_sweep.report.pictures.style import DATA, LABELS, OUTSIDE, WIDTH, limits, log_frequency
from rover_sweep.spectra.exponentials import Complex

BLOCK, HEAD, FOOT = 3.6, 0.5, 0.5  # in


def bode_figure(responses: Sequence[Bode]) -> Figure:
    """Magnitude and phase of each response; outside of the coherent band shaded."""
    rows = (len(responses) + 1) // 2
    height = BLOCK * rows + HEAD + FOOT
    figure = Figure(figsize=(WIDTH, height))
    outer = figure.add_gridspec(
        rows, 2, left=0.075, right=0.985, top=1 - HEAD / height, bottom=FOOT / height, wspace=0.2, hspace=0.3
    )
    for k, b in enumerate(responses):
        inner = outer[k // 2, k % 2].subgridspec(2, 1, height_ratios=(3, 2.4), hspace=0.09)
        first = figure.add_subplot(inner[0])
        _block(first, figure.add_subplot(inner[1]), b)
    handles, names = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, names, loc="upper left", bbox_to_anchor=(0.065, 1.0), ncols=len(names))
    return figure


def _block(magnitude: Axes, phase: Axes, b: Bode) -> None:
    inside = _inside(b)
    lines: dict[str, tuple[Complex, dict[str, Any]]] = {
        "recorded": (b.recorded, {"color": DATA, "linewidth": 1.8}),
        "before": (b.before, BEFORE),
        "after": (b.after, AFTER),
    }
    db, deg = {}, {}
    for name, (h, style) in lines.items():
        db[name] = 20 * np.log10(np.maximum(np.abs(h), 1e-9))
        deg[name] = _phase(h, inside)
        magnitude.plot(b.w, db[name], label=name, **style)
        phase.plot(b.w, deg[name], **style)
    magnitude.set_ylim(*limits([x[inside] for x in db.values()], 20))
    phase.set_ylim(*limits([x[inside] for x in deg.values()], 100))
    magnitude.set_ylabel("magnitude, dB")
    phase.set_ylabel("phase, deg")
    magnitude.set_title(f"{LABELS.get(b.output, b.output)} / steering")
    for axes in (magnitude, phase):
        _outside(axes, b)
        log_frequency(axes, 0.93 * float(b.w[0]), 1.07 * float(b.w[-1]), labelled=axes is phase)


def _inside(b: Bode) -> Array:
    low, high = b.band or (b.w[0], b.w[-1])
    return np.asarray((b.w >= low * 0.999) & (b.w <= high * 1.001))


def _phase(h: Complex, inside: Array) -> Array:
    """Phase [deg], unwrapped from the lowest coherent frequency on."""
    deg = np.degrees(np.unwrap(np.angle(h)))
    first = float(deg[inside][0])
    return np.asarray(deg - 360.0 * np.round(first / 360.0))


def _outside(axes: Axes, b: Bode) -> None:
    if b.band:
        for low, high in ((1e-4, b.band[0]), (b.band[1], 1e4)):
            axes.axvspan(low, high, color=OUTSIDE, linewidth=0, zorder=0)
