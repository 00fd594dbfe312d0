"""One run measured and simulated before and after, with noise, residual and its spectrum."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.residual_maps import ordinal
from rover_sweep.diagnosis.result import LawCurve, LawHeldOut, Mismatch, Profile, TimeHistory
from rover_sweep.report.pictures.picture import (
    BAND,
    DATA,
    MODEL_LINES,
    OUTSIDE,
    WIDTH,
    literal,
    log_frequency,
)
from rover_sweep.report.wording import LONG_CHANNELS

# Colour, dash and weight differ, so that the lines are distinct in print too.
BEFORE: dict[str, Any] = {"color": "#0072B2", "linestyle": (0, (4, 1.5)), "linewidth": 1.4}
AFTER: dict[str, Any] = {"color": "#D55E00", "linestyle": "-", "linewidth": 1.4}
NOISE = "#C8C8C8"
SHADE = "#FBE9C6"
DEG = 180 / np.pi
ROW, HEAD, FOOT = 2.5, 0.45, 0.5  # in
CLOSE_UP, SHORTEST = 5.0, 1.2  # s, longest (a quarter of the slowest motion) and shortest close-up
SWINGS = 5.0  # periods shown in a close-up


def overlay_figure(channels: Sequence[TimeHistory], changed: bool = True) -> Figure:
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


def _factor(o: TimeHistory) -> float:
    return DEG if o.channel in ("r", "p") else 1.0


def draw_overlay(
    axes: Axes, o: TimeHistory, changed: bool, part: tuple[float, float] | None = None, last: bool = False
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


def _residual(axes: Axes, o: TimeHistory, changed: bool) -> None:
    """Measured minus simulated over the whole run, with twice the noise."""
    t, f = o.t - o.t[0], _factor(o)
    axes.axhspan(-2 * o.noise * f, 2 * o.noise * f, color=NOISE, linewidth=0)
    axes.plot(t, (o.measured - o.before) * f, **{**BEFORE, "linestyle": "-", "linewidth": 0.8})
    if changed:
        axes.plot(t, (o.measured - o.after) * f, **{**AFTER, "linewidth": 0.8})
    axes.margins(x=0.0)


def _close_up(channels: Sequence[TimeHistory], changed: bool) -> tuple[float, float]:
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


def _period(o: TimeHistory, t: Array, start: float) -> float:
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


def draw_residual(axes: Axes, o: TimeHistory, changed: bool) -> None:
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


# The curves of unknown laws with their bands, and the held-out runs without and with them.


HEIGHT = 3.4  # in
LAW_BEFORE, LAW_AFTER = "#BDBDBD", "#D55E00"


def law_curves(curves: tuple[LawCurve, ...], held_out: tuple[LawHeldOut, ...] = ()) -> Figure:
    """A panel for each curve, and one with the mean square of the held-out rows before and after."""
    panels = len(curves) + bool(held_out)
    rows = (panels + 1) // 2
    figure = Figure(figsize=(WIDTH, rows * HEIGHT), layout="constrained")
    axes = [figure.add_subplot(rows, min(panels, 2), k + 1) for k in range(panels)]
    for curve, panel in zip(curves, axes, strict=False):
        draw_curve(curve, panel)
    if held_out:
        _held_out(held_out, axes[-1])
    return figure


def draw_curve(curve: LawCurve, axes: Axes) -> None:
    """The curve with its 90 % band, and the straight line through its middle."""
    axes.axhline(0.0, color="#777777", linewidth=0.8)
    turn = int(np.argmax(curve.x)) + 1  # a curve with a loop goes back from here
    for part in (slice(0, turn), slice(turn, None)):
        label = "" if part.start else "90 % band"
        low, high = curve.low[part], curve.high[part]
        axes.fill_between(curve.x[part], low, high, color=BAND, alpha=0.35, linewidth=0, label=label)
    axes.plot(curve.x, curve.y, marker="o", markersize=4, **MODEL_LINES["roll-yaw"], label="fitted law")
    if not curve.gain:  # of a law with a name
        axes.plot(
            curve.x,
            curve.straight(curve.x),
            color="#333333",
            linestyle=(0, (4, 2)),
            linewidth=1.0,
            label="linear",
        )
    if curve.memory == "resonance":
        axes.set_title(literal(f"{curve.place}: resonance of {curve.over} at {curve.size:.2g} Hz"))
        axes.set_xlabel(literal(f"frequency, {curve.over_unit}"))
        axes.set_xscale("log")
    else:
        times = f", times {curve.times}" if curve.times else ""
        memory = f" ({curve.memory} of {curve.size:.3g})" if curve.memory else ""
        axes.set_title(literal(f"{curve.place}{times}"))
        axes.set_xlabel(literal(f"{curve.over}{memory}, {curve.over_unit}"))
    axes.set_ylabel(literal(curve.unit))
    axes.legend()


def _held_out(runs: tuple[LawHeldOut, ...], axes: Axes) -> None:
    at = np.arange(len(runs))
    axes.bar(at - 0.2, [h.before for h in runs], 0.38, color=LAW_BEFORE, label="without")
    axes.bar(
        at + 0.2, [h.after for h in runs], 0.38, color=LAW_AFTER, hatch="//", edgecolor="white", label="with"
    )
    axes.axhline(1.0, color="#333333", linestyle=(0, (4, 2)), linewidth=1.0, label="noise")
    axes.set_xticks(at, [literal(h.run) for h in runs])
    axes.set_title("held-out runs: mean square over noise")
    axes.grid(axis="x", visible=False)
    axes.legend()


# A small picture of one mismatch: the residual against the quantity that it depends on.


SIZE = (5.2, 2.3)  # in
FLOOR = "#555555"
REST = "#9CC3DF"
MANY = 25  # points from which the markers are smaller
OVER = {
    "harmonic": "harmonic of the steering frequency",
    "amplitude": "largest steering angle",
    "time": "time in the run",
    "run": "",
}


def drawable(m: Mismatch, overlays: Sequence[TimeHistory]) -> bool:
    """True if the mismatch has a profile or a spectrum to draw."""
    return _filled(m) is not None or bool(_spectra(m, overlays))


def mismatch(m: Mismatch, overlays: Sequence[TimeHistory]) -> Figure:
    """The residual against its profile's quantity if it has one, else against frequency; 1: noise floor."""
    figure = Figure(figsize=SIZE)
    axes = figure.add_axes((0.125, 0.235, 0.795, 0.735))
    profile = _filled(m)
    if profile is None:
        _frequency(axes, m, _spectra(m, overlays))
    else:
        _profile(axes, m, profile)
        if profile.over == "frequency":
            _shade(axes, m.band)
    below = profile is not None and min(profile.ratio) < 0
    if not below:
        axes.set_ylim(bottom=0)
    for floor in (-1.0, 1.0) if below else (1.0,):
        axes.axhline(floor, color=FLOOR, linewidth=1.0, linestyle=(0, (4, 2)))
    axes.set_ylabel("mean / its uncertainty" if m.condition == "steady" else "residual / noise")
    axes.text(1.01, 1.0, "noise", transform=axes.get_yaxis_transform(), va="center", fontsize=8, color=FLOOR)
    return figure


def _filled(m: Mismatch) -> Profile | None:
    """The profile, None without values."""
    return m.profile if m.profile is not None and m.profile.ratio else None


def _spectra(m: Mismatch, overlays: Sequence[TimeHistory]) -> list[TimeHistory]:
    return [o for o in overlays if o.channel == m.channel and o.w.size > 1]


def _profile(axes: Axes, m: Mismatch, profile: Profile) -> None:
    """Bars for words and for few values, darker for those named in the condition; else a line."""
    labels = _labels(profile)
    if labels:
        named = [label in m.condition.split() or f"{label} " in m.condition for label in labels]
        colours = [BEFORE["color"] if one or not any(named) else REST for one in named]
        axes.bar(range(len(labels)), profile.ratio, color=colours, width=0.55)
        axes.set_xticks(range(len(labels)), labels)
        axes.set_xlim(-0.6, len(labels) - 0.4)
        axes.grid(axis="x", visible=False)
    else:
        size = 4 if len(profile.x) < MANY else 2
        axes.plot(profile.x, profile.ratio, color=BEFORE["color"], marker="o", markersize=size)
    axes.set_xlabel(_quantity(profile))
    if profile.over == "frequency":
        x = [float(v) for v in profile.x]
        log_frequency(axes, 0.9 * min(x), 1.1 * max(x), labelled=True)


def _quantity(profile: Profile) -> str:
    """Label of the x axis, with its unit."""
    unit = f", {profile.unit.replace('us', 'µs')}" if profile.unit else ""
    return f"{OVER.get(profile.over, profile.over)}{unit}"


def _labels(profile: Profile) -> list[str]:
    """Labels under the bars; none if the profile is drawn as a line."""
    if profile.over == "harmonic":
        return [ordinal(round(float(k))) for k in profile.x]
    if all(isinstance(x, str) for x in profile.x):
        return [str(x) for x in profile.x]
    digits = {"amplitude": 1, "speed": 2}.get(profile.over)
    return [] if digits is None else [f"{float(x):.{digits}f}" for x in profile.x]


def _frequency(axes: Axes, m: Mismatch, spectra: Sequence[TimeHistory]) -> None:
    low, high = min(o.w[0] for o in spectra), max(o.w[-1] for o in spectra)
    for k, o in enumerate(spectra):
        colour = BEFORE["color"] if k == 0 else AFTER["color"] if k == 1 else OUTSIDE
        axes.plot(o.w, np.sqrt(o.residual_before), color=colour, label=literal(o.run), alpha=0.9)
    _shade(axes, m.band)
    log_frequency(axes, 0.95 * float(low), 1.05 * float(high), labelled=True)
    if len(spectra) > 1:
        axes.legend(fontsize=8)


def _shade(axes: Axes, band: tuple[float, float]) -> None:
    """Shade a frequency band; 0 rad/s is the left end of the logarithmic axis."""
    axes.axvspan(max(band[0], 1e-3), band[1], color=SHADE, linewidth=0, zorder=0)
