"""One run measured and simulated before and after, with noise, residual and its spectrum."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.result import Overlay
from rover_sweep.report.pictures.style import DATA, WIDTH, log_frequency
from rover_sweep.report.wording.effect_names import LONG_CHANNELS

# Colour, dash and weight differ, so that the lines are distinct in print too.
BEFORE: dict[str, Any] = {"color": "#0072B2", "linestyle": (0, (4, 1.5)), "linewidth": 1.4}
AFTER: dict[str, Any] = {"color": "#D55E00", "linestyle": "-", "linewidth": 1.4}
NOISE = "#C8C8C8"
SHADE = "#FBE9C6"
DEG = 180 / np.pi
ROW, HEAD, FOOT = 2.5, 0.45, 0.5  # in
CLOSE_UP, SHORTEST = 5.0, 1.2  # s, longest (a quarter of the slowest motion) and shortest close-up
SWINGS = 5.0  # periods shown in a close-up


def overlay_figure(channels: Sequence[Overlay], changed: bool = True) -> Figure:
    """A row per channel: the run and its residual, a close-up, the residual's spectrum.

    changed: also draw the simulation after the findings.
    """
    height = HEAD + FOOT + ROW * len(channels)
    figure = Figure(figsize=(WIDTH, height))
    rows = figure.add_gridspec(
        len(channels),
        3,
        width_ratios=(2.3, 1.45, 1.2),
        left=0.07,
        right=0.99,
        top=1 - HEAD / height,
        bottom=FOOT / height,
        wspace=0.17,
        hspace=0.24,
    )
    close_up = _close_up(channels, changed)
    for k, o in enumerate(channels):
        left = rows[k, 0].subgridspec(2, 1, height_ratios=(1.7, 1), hspace=0.1)
        panels = [figure.add_subplot(s) for s in (left[0], left[1], rows[k, 1], rows[k, 2])]
        draw_overlay(panels[0], o, changed)
        _residual(panels[1], o, changed)
        draw_overlay(panels[2], o, changed, close_up)
        draw_residual(panels[3], o, changed)
        panels[0].set_ylabel(LONG_CHANNELS.get(o.channel, o.channel), fontsize=9)
        panels[1].set_ylabel("residual", fontsize=9)
        for axes in panels[:2]:
            axes.axvspan(*close_up, color=SHADE, linewidth=0, zorder=0)
            axes.yaxis.set_label_coords(-0.105, 0.5)
        if k == 0:
            panels[3].set_title("residual / noise", fontsize=9.5)
            handles, names = panels[0].get_legend_handles_labels()
            figure.legend(handles, names, loc="upper left", bbox_to_anchor=(0.06, 1.0), ncols=len(names))
        if k == len(channels) - 1:
            for axes, label in zip(panels[1:], ("time, s", "time, s", "frequency, rad/s"), strict=True):
                axes.set_xlabel(label)
    return figure


def _factor(o: Overlay) -> float:
    return DEG if o.channel in ("r", "p") else 1.0


def draw_overlay(
    axes: Axes, o: Overlay, changed: bool, part: tuple[float, float] | None = None, last: bool = False
) -> None:
    """Measured with twice the noise, before and (if changed) after; part: (start, end) [s] to show.

    last: label the time, although the whole run is shown.
    """
    t, inside = o.t - o.t[0], np.ones(o.t.size, dtype=bool)
    if part:
        inside = (t >= part[0]) & (t <= part[1])
    f, t = _factor(o), t[inside]
    measured, spread = o.measured[inside] * f, 2 * o.noise * f
    axes.fill_between(t, measured - spread, measured + spread, color=NOISE, linewidth=0, label="± 2 × noise")
    axes.plot(t, measured, color=DATA, linewidth=0.9, label="measured")
    axes.plot(t, o.before[inside] * f, label="before" if changed else "model", **BEFORE)
    if changed:
        axes.plot(t, o.after[inside] * f, label="after", **AFTER)
    axes.margins(x=0.0)
    if part is None and not last:
        axes.tick_params(labelbottom=False)


def _residual(axes: Axes, o: Overlay, changed: bool) -> None:
    """Measured minus simulated over the whole run, with twice the noise."""
    t, f = o.t - o.t[0], _factor(o)
    axes.axhspan(-2 * o.noise * f, 2 * o.noise * f, color=NOISE, linewidth=0)
    axes.plot(t, (o.measured - o.before) * f, **{**BEFORE, "linestyle": "-", "linewidth": 0.8})
    if changed:
        axes.plot(t, (o.measured - o.after) * f, **{**AFTER, "linewidth": 0.8})
    axes.margins(x=0.0)


def _close_up(channels: Sequence[Overlay], changed: bool) -> tuple[float, float]:
    """(start, end) [s] of the part of the run with the largest difference relative to the noise."""
    o = channels[0]
    t = o.t - o.t[0]
    power = np.zeros(t.size)
    for c in channels:
        gap = (c.before - c.after) if changed else (c.before - c.measured)
        power += np.interp(t, c.t - c.t[0], np.nan_to_num(gap) / max(c.noise, 1e-12)) ** 2
    start = float(t[_busiest(power, t, min(CLOSE_UP, float(t[-1])))])
    length = min(float(t[-1]), max(SHORTEST, min(CLOSE_UP, SWINGS * _period(o, t, start))))
    start = float(t[_busiest(power, t, length)])
    return start, start + length


def _period(o: Overlay, t: Array, start: float) -> float:
    """Mean period [s] of the simulated motion in the CLOSE_UP seconds from `start`; long without swings."""
    inside = (t >= start) & (t <= start + CLOSE_UP)
    x = np.nan_to_num(o.before[inside])
    crossings = int(np.count_nonzero(np.diff(np.signbit(x - x.mean())))) if x.size else 0
    return 2 * CLOSE_UP / max(crossings, 1)


def _busiest(power: Array, t: Array, length: float) -> int:
    """Start index of the window of this length [s] with the largest sum."""
    n = max(1, int(np.searchsorted(t, length)))
    total = np.concatenate(([0.0], np.cumsum(power)))
    return int(np.argmax(total[n:] - total[:-n])) if n < t.size else 0


def draw_residual(axes: Axes, o: Overlay, changed: bool) -> None:
    """Spectrum of the residual over the noise floor, before and (if changed) after."""
    if o.w.size < 2:
        axes.text(0.5, 0.5, "no spectrum", ha="center", transform=axes.transAxes, color="#777777")
        return
    before, after = np.sqrt(o.residual_before), np.sqrt(o.residual_after)
    axes.plot(o.w, before, **BEFORE)
    if changed:
        axes.plot(o.w, after, **AFTER)
    axes.axhline(1.0, color="#555555", linewidth=1.0, linestyle=(0, (1, 1.5)))
    axes.set_yscale("log")
    shown = before if not changed else np.concatenate((before, after))
    shown = shown[np.isfinite(shown) & (shown > 0)]
    axes.set_ylim(
        min(0.5, 0.8 * float(shown.min(initial=1.0))), max(3.0, 1.3 * float(shown.max(initial=1.0)))
    )
    ticks = [k for k in (0.1, 0.3, 1, 3, 10, 30, 100, 300) if axes.get_ylim()[0] <= k <= axes.get_ylim()[1]]
    axes.set_yticks(ticks, [f"{k:g}" for k in ticks])
    axes.minorticks_off()
    log_frequency(axes, float(o.w[0]), float(o.w[-1]), labelled=False)
    axes.tick_params(labelbottom=True)
