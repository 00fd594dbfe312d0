"""Frequency responses with coherence (Figure 3 of the paper), and with the models over them (Figure 6)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import MultipleLocator

from rover_sweep.comparison.answer import Bode
from rover_sweep.data.recording import Array, Recording, Signal
from rover_sweep.diagnosis.result import Diagnosis
from rover_sweep.identification.fit import costs
from rover_sweep.identification.grouping import Group
from rover_sweep.identification.pipeline import ModelResult
from rover_sweep.identification.verify import Overlay, Verification
from rover_sweep.report.pictures.overlay import AFTER, BEFORE
from rover_sweep.report.pictures.picture import (
    BAND,
    DATA,
    LABELS,
    OUTSIDE,
    QUIET,
    WIDTH,
    limits,
    literal,
    log_frequency,
    model_line,
)
from rover_sweep.report.wording import band
from rover_sweep.spectra.response import COHERENCE_GOOD, FrequencyResponse
from rover_sweep.spectra.response import inside_band as _inside
from rover_sweep.spectra.response import nearest_turn as _nearest_turn
from rover_sweep.spectra.response import unwrapped_phase as _phase
from rover_sweep.spectra.windowed import Complex

Models = Mapping[str, ModelResult]
ROOM = 48  # characters of the models' names and costs that fit above a panel
BLOCK = 4.9  # in, height of magnitude, phase and coherence of one response


def measured_responses(group: Group) -> Figure:
    """All responses of a group: magnitude and phase with two standard deviations, coherence, usable band."""
    return _figure(group, {})


def modelled_responses(group: Group, models: Models) -> Figure:
    """As `measured_responses`, with the models' responses (including the known sensor filters)."""
    return _figure(group, models)


def _figure(group: Group, models: Models) -> Figure:
    found = list(group.responses.values())
    rows = (len(found) + 1) // 2
    height = BLOCK * rows + 0.5
    figure = Figure(figsize=(WIDTH, height))
    outer = figure.add_gridspec(
        rows, 2, left=0.075, right=0.985, top=1 - 0.85 / height, bottom=0.5 / height, wspace=0.2, hspace=0.24
    )
    span = 0.93 * min(f.w[0] for f in found), 1.07 * max(f.w[-1] for f in found)
    for k, f in enumerate(found):
        inner = outer[k // 2, k % 2].subgridspec(3, 1, height_ratios=(3, 2.4, 1.3), hspace=0.09)
        first = figure.add_subplot(inner[0])
        rest = [figure.add_subplot(inner[i]) for i in (1, 2)]
        draw_response([first, *rest], f, span, group, models)
    handles, names = figure.axes[0].get_legend_handles_labels()
    figure.legend(
        handles,
        names,
        loc="upper left",
        bbox_to_anchor=(0.065, 1.0),
        ncols=len(names) if len(names) <= 5 else 4,
    )
    return figure


def draw_response(
    panels: Sequence[Axes],
    f: FrequencyResponse,
    span: tuple[float, float],
    group: Group | None = None,
    models: Models = MappingProxyType({}),
) -> None:
    """Magnitude, phase and coherence on three panels over span [rad/s]; models only with the group of f."""
    magnitude, phase, coherence = panels
    lines = {
        name: _model_line(m, f, group)
        for name, m in models.items()
        if group is not None and f.output in m.fit.structure.outputs
    }
    deg = _phase(f.h, f)
    _measured(magnitude, phase, f, deg)
    models_deg = {name: _nearest_turn(_phase(h, f), deg, f) for name, h in lines.items()}
    for name, h in lines.items():
        magnitude.plot(
            f.w, 20 * np.log10(np.abs(h)), label=f"{name} model", zorder=3, **model_line(name, models)
        )
        phase.plot(f.w, models_deg[name], zorder=3, **model_line(name, models))
    inside = _inside(f)
    models_db = [20 * np.log10(np.abs(h[inside])) for h in lines.values()]
    magnitude.set_ylim(*limits([f.magnitude_db[inside], *models_db], 20))
    magnitude.set_ylabel("magnitude, dB")
    phase.set_ylim(*limits([deg[inside], *(d[inside] for d in models_deg.values())], 100))
    phase.yaxis.set_major_locator(MultipleLocator(45 if np.ptp(phase.get_ylim()) < 330 else 90))
    phase.set_ylabel("phase, deg")
    _coherence(coherence, f)
    magnitude.set_title(_title(f, group, models))
    for axes in panels:
        _outside(axes, f)
        log_frequency(axes, *span, labelled=axes is coherence)
        axes.yaxis.set_label_coords(-0.12, 0.5)


def _measured(magnitude: Axes, phase: Axes, f: FrequencyResponse, deg: Array) -> None:
    """The measured response with a band of two standard deviations of its random error."""
    error = np.clip(2 * np.nan_to_num(f.random_error, nan=1.0), 0, 0.95)
    db, spread = f.magnitude_db, np.degrees(np.arcsin(error))
    low, high = db + 20 * np.log10(1 - error), db + 20 * np.log10(1 + error)
    magnitude.fill_between(f.w, low, high, color="#BBBBBB", linewidth=0, label="random error, 2 sd")
    if f.band:
        phase.fill_between(f.w, deg - spread, deg + spread, color="#BBBBBB", linewidth=0)
    magnitude.plot(f.w, db, color=DATA, linewidth=1.8, label="measured")
    if f.band:
        phase.plot(f.w, deg, color=DATA, linewidth=1.8)
    else:
        phase.plot(f.w, deg, ".", color=DATA, markersize=3)


def _coherence(axes: Axes, f: FrequencyResponse) -> None:
    axes.plot(f.w, f.coherence, color=DATA, linewidth=1.5)
    axes.axhline(COHERENCE_GOOD, color=BAND, linewidth=1.0, linestyle=(0, (4, 2)))
    axes.set_ylim(0, 1.04)
    axes.set_yticks([0, COHERENCE_GOOD, 1])
    axes.set_ylabel("partial coh." if f.conditioned_on else "coherence")


def _outside(axes: Axes, f: FrequencyResponse) -> None:
    """Shade the range outside the usable band, and mark its ends."""
    low, high = f.band or (f.w[-1], f.w[-1])
    for a, b in ((1e-4, low), (high, 1e4)):
        axes.axvspan(a, b, color=OUTSIDE, linewidth=0, zorder=0)
    if f.band:
        for edge in f.band:
            axes.axvline(edge, color=BAND, linewidth=1.2)


def _title(f: FrequencyResponse, group: Group | None, models: Models) -> str:
    """Title: the response and its unit, below it J of each model at this speed."""
    without = f" without {', '.join(f.conditioned_on)}" if f.conditioned_on else ""
    what = f"{LABELS[f.output]} / steering{without}, {f.unit.replace('^2', '²')}"
    if group is None or not models:
        return f"{what}\n{'usable ' + band(f.band) + ' rad/s' if f.band else 'no usable band'}"
    having = {name: m for name, m in models.items() if f.band and f.output in m.fit.structure.outputs}
    if not having:
        return f"{what}\nin no model" if f.band else f"{what}\nno usable band"
    seen = [group.condition((f.output,))]
    values = {name: f"{costs(m.fit.structure, seen)[f.output]:.1f}" for name, m in having.items()}
    listed = ", ".join(f"{name} {j}" for name, j in values.items())
    if len(listed) > ROOM:
        listed = f"{', '.join(values.values())}, in the legend's order"
    fitted = any(f.output in m.fit.costs for m in having.values())
    return f"{what}\nJ: {listed}" + ("" if fitted else " (not in the fit)")


def _model_line(model: ModelResult, f: FrequencyResponse, group: Group) -> Complex:
    return model.fit.structure.response(f.w, group.speed, f.output, group.runs[0].filters)


# Responses of recording and simulation, before and after, over each other.


BODE_BLOCK, HEAD, FOOT = 3.6, 0.5, 0.5  # in


def bode_figure(responses: Sequence[Bode]) -> Figure:
    """Magnitude and phase of each response; outside of the coherent band shaded."""
    rows = (len(responses) + 1) // 2
    height = BODE_BLOCK * rows + HEAD + FOOT
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
    inside = _bode_inside(b)
    lines: dict[str, tuple[Complex, dict[str, Any]]] = {
        "recorded": (b.recorded, {"color": DATA, "linewidth": 1.8}),
        "before": (b.before, BEFORE),
        "after": (b.after, AFTER),
    }
    db, deg = {}, {}
    for name, (h, style) in lines.items():
        db[name] = 20 * np.log10(np.maximum(np.abs(h), 1e-9))
        deg[name] = _bode_phase(h, inside)
        magnitude.plot(b.w, db[name], label=name, **style)
        phase.plot(b.w, deg[name], **style)
    magnitude.set_ylim(*limits([x[inside] for x in db.values()], 20))
    phase.set_ylim(*limits([x[inside] for x in deg.values()], 100))
    magnitude.set_ylabel("magnitude, dB")
    phase.set_ylabel("phase, deg")
    magnitude.set_title(f"{LABELS.get(b.output, b.output)} / steering")
    for axes in (magnitude, phase):
        _bode_outside(axes, b)
        log_frequency(axes, 0.93 * float(b.w[0]), 1.07 * float(b.w[-1]), labelled=axes is phase)


def _bode_inside(b: Bode) -> Array:
    low, high = b.band or (b.w[0], b.w[-1])
    return np.asarray((b.w >= low * 0.999) & (b.w <= high * 1.001))


def _bode_phase(h: Complex, inside: Array) -> Array:
    """Phase [deg], unwrapped from the lowest coherent frequency on."""
    deg = np.degrees(np.unwrap(np.angle(h)))
    first = float(deg[inside][0])
    return np.asarray(deg - 360.0 * np.round(first / 360.0))


def _bode_outside(axes: Axes, b: Bode) -> None:
    if b.band:
        for low, high in ((1e-4, b.band[0]), (b.band[1], 1e4)):
            axes.axvspan(low, high, color=OUTSIDE, linewidth=0, zorder=0)


# Models with the steering of a verification run as input, as Figure 7 of the paper.


def verification(run: Recording | None, verdicts: Mapping[str, Verification]) -> Figure:
    """Steering of `run` (if given), and each channel measured and predicted by every model."""
    channels = [c for c in ("r", "ay", "p") if any(_overlay(v, c) for v in verdicts.values())]
    steering = run is not None and "delta" in run
    rows = len(channels) + steering
    columns = len(verdicts) + 1 if len(verdicts) < 5 else 3  # of the legend
    top = 0.4 + 0.22 * (-(-(len(verdicts) + 1) // columns) - 1)
    height = 0.55 + top + 0.95 * steering + 2.05 * len(channels)
    figure = Figure(figsize=(WIDTH, height))
    panels = figure.subplots(
        rows, 1, sharex=True, squeeze=False, height_ratios=[0.95] * steering + [2.05] * len(channels)
    )[:, 0]
    figure.subplots_adjust(left=0.085, right=0.985, top=1 - top / height, bottom=0.52 / height, hspace=0.12)
    start = _start(run, verdicts)
    if run is not None and steering:
        delta = run.manoeuvre("delta")
        panels[0].plot(
            delta.t - start, np.degrees(delta.x), color=DATA, drawstyle="steps-post" if delta.hold else None
        )
        panels[0].set_ylabel("steering, deg")
    for axes, channel in zip(panels[int(steering) :], channels, strict=True):
        draw_predicted(axes, channel, verdicts, start)
    for axes in panels:
        axes.yaxis.set_label_coords(-0.055, 0.5)
    panels[-1].set_xlabel("time since start of the manoeuvre, s")
    panels[-1].margins(x=0.01)
    handles, names = panels[int(steering)].get_legend_handles_labels()
    figure.legend(handles, names, loc="upper left", bbox_to_anchor=(0.075, 1.0), ncols=columns)
    return figure


def draw_predicted(axes: Axes, channel: str, verdicts: Mapping[str, Verification], start: float) -> None:
    """A channel measured and predicted by every model, over the time since `start` [s]."""
    drawn = False
    for name, verdict in verdicts.items():
        overlay = _overlay(verdict, channel)
        if overlay is None:
            continue
        if not drawn:
            axes.plot(
                overlay.t - start, overlay.measured, color=DATA, linewidth=0.9, alpha=0.75, label="measured"
            )
            axes.set_ylabel(f"{LABELS[channel]}\n{overlay.unit.replace('^2', '²')}")
            drawn = True
        words = f"{name}: $J_{{rms}}$ {verdict.j_rms:.2f}, TIC {verdict.tic:.3f}"
        axes.plot(overlay.t - start, overlay.model, label=words, **model_line(name, verdicts))


def _overlay(v: Verification, channel: str) -> Overlay | None:
    return next((o for o in v.overlays if o.channel == channel), None)


def _start(run: Recording | None, verdicts: Mapping[str, Verification]) -> float:
    return run.span[0] if run is not None else float(next(iter(verdicts.values())).overlays[0].t[0])


# Time history of a run: steering and motion, as Figure 2 of the paper.


MARGIN = 4.0  # s shown before and after the manoeuvre
DEG = 180 / np.pi
ROWS = (
    ("r", "yaw rate r\ndeg/s", DEG),
    ("ay", "lateral acc. $a_y$\nm/s²", 1.0),
    ("p", "roll rate p\ndeg/s", DEG),
    ("speed", "speed V\nm/s", 1.0),
)


def history(run: Recording) -> Figure:
    """Steering, yaw rate, lateral acceleration, roll rate and speed over time since the manoeuvre began."""
    rows = [("pwm", "steering\nPWM, µs", 1.0)] if "pwm" in run else [("delta", "road-wheel\nangle, deg", DEG)]
    rows += [row for row in ROWS if row[0] in run]
    figure = Figure(figsize=(WIDTH, 1.0 + 1.35 * len(rows)))
    grid = figure.subplots(len(rows), 1, sharex=True, squeeze=False)[:, 0]
    figure.subplots_adjust(
        left=0.095,
        right=0.91,
        top=1 - 0.32 / figure.get_figheight(),
        bottom=0.52 / figure.get_figheight(),
        hspace=0.14,
    )
    for axes, row in zip(grid, rows, strict=True):
        draw_channel(axes, run, *row)
    _angle_axis(grid[0], run)
    start, end = run.span
    grid[-1].set_xlim(-MARGIN, end - start + MARGIN)
    grid[-1].set_xlabel("time since start of the manoeuvre, s")
    grid[0].set_title(f"{literal(run.name)}: {run.kind}, mean speed {run.mean_speed:.2f} m/s")
    return figure


def draw_channel(axes: Axes, run: Recording, channel: str, label: str, factor: float) -> None:
    """One channel times a factor over time, with its surroundings shaded and the quiet intervals marked."""
    start, end = run.span
    shown = run[channel].between(start - MARGIN, end + MARGIN)
    axes.plot(
        shown.t - start,
        shown.x * factor,
        color=DATA,
        linewidth=0.9,
        drawstyle="steps-post" if shown.hold else "default",
    )
    axes.set_ylabel(label)
    axes.yaxis.set_label_coords(-0.055, 0.5)
    _scale(axes, shown, run.manoeuvre(channel), factor)
    for a, b in ((-MARGIN, 0.0), (end - start, end - start + MARGIN)):
        axes.axvspan(a, b, color=OUTSIDE, linewidth=0)
    for a, b in (*run.standstill, *run.straight):
        low, high = max(a - start, -MARGIN), min(b - start, end - start + MARGIN)
        if high > low:
            axes.axvspan(low, high, ymax=0.05, color=QUIET, linewidth=0)


def _scale(axes: Axes, shown: Signal, inside: Signal, factor: float) -> None:
    """Axis limits from the manoeuvre only, so that the start and stop do not compress it."""
    x = inside.x * factor if inside.x.size else shown.x * factor
    spare = 0.12 * (float(np.ptp(x)) or 1.0)
    axes.set_ylim(float(x.min()) - spare, float(x.max()) + spare)


def _angle_axis(axes: Axes, run: Recording) -> None:
    """Right axis with the road-wheel angle, if it was computed from the PWM."""
    if "pwm" not in run or "delta" not in run:
        return
    pwm, delta = run["pwm"].x, run["delta"].x
    if pwm.size != delta.size or np.ptp(pwm) == 0:
        return
    slope, offset = np.polyfit(pwm, delta * DEG, 1)
    right = axes.secondary_yaxis(
        "right", functions=(lambda u: u * slope + offset, lambda d: (d - offset) / slope)
    )
    right.set_ylabel("angle, deg\nleft positive")


# All candidates' scores as a bar chart.


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
