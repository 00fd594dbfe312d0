"""Simulation against recording: histories, residuals, places that differ, responses, and fitted curves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from rover_sweep.comparison.answer import Bode
from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.residual_maps import ordinal
from rover_sweep.diagnosis.result import LawCurve, Mismatch, Profile, TimeHistory
from rover_sweep.report.charts.chart import (
    AFTER,
    BEFORE,
    CHANNEL_WORDS,
    DATA,
    DEGREES,
    SHADE,
    Chart,
    ChartPlan,
    Curve,
    Panel,
    Spread,
    Stack,
)
from rover_sweep.report.charts.response_charts import bode_stack
from rover_sweep.report.wording import OUTPUT_NAMES, channel

# One run measured and simulated before and after, its residual, and the residual over frequency.


def planned_histories(
    overlays: Sequence[TimeHistory], name: str, used: str, words: str, changed: bool = True
) -> tuple[ChartPlan, ...]:
    """A chart of each run. name: of the files; used: what a run that is not held out is; words: for all."""
    by_run: dict[tuple[str, bool], list[TimeHistory]] = {}
    for o in overlays:
        by_run.setdefault((o.run, o.held_out), []).append(o)
    return tuple(
        ChartPlan(
            f"{name}-{k}",
            f"{run}, {'held out' if held_out else used}. {words}",
            partial(overlay_chart, tuple(channels), changed),
        )
        for k, ((run, held_out), channels) in enumerate(by_run.items())
    )


def overlay_chart(channels: Sequence[TimeHistory], changed: bool = True) -> Chart:
    """Time histories with residuals, then the spectra. changed: also the simulation after the findings."""
    run = channels[0]
    panels = tuple(panel for o in channels for panel in _histories(o, changed))
    whole, part = (0.0, max(float(o.t[-1] - o.t[0]) for o in channels)), _close_up(channels, changed)
    signals = tuple(_signal(o, changed, part) for o in channels)
    most = "before and after differ most" if changed else "the error is largest"
    stacks = [
        Stack(run.run, "time, s", panels, whole, shades=((*part, SHADE),)),
        Stack(f"{run.run}, close-up where {most} (shaded above)", "time, s", signals, part),
    ]
    return Chart((*stacks, *_spectra_stack(channels, changed)))


def _histories(o: TimeHistory, changed: bool) -> tuple[Panel, Panel]:
    f, first = _shown(o, changed)
    left = [Curve(f"residual {first}", (o.measured - o.before) * f, BEFORE["colour"], width=1.0)]
    if changed:
        left.append(Curve("residual after", (o.measured - o.after) * f, AFTER["colour"], width=1.0))
    unit, noise = CHANNEL_WORDS.get(o.channel, o.channel).rpartition(", ")[2], 2 * o.noise * f
    residual = Panel(f"residual, {unit}", o.t - o.t[0], tuple(left), levels=(-noise, noise), height=100)
    return _signal(o, changed), residual


def _signal(o: TimeHistory, changed: bool, part: tuple[float, float] | None = None) -> Panel:
    """Measured, before and (if changed) after. part: (start, end) [s] to show."""
    (f, first), t = _shown(o, changed), o.t - o.t[0]
    lines = [Curve("measured", o.measured * f, DATA, width=1.0), Curve(first, o.before * f, **BEFORE)]
    lines += [Curve("after", o.after * f, **AFTER)] if changed else []
    if part:
        kept = (t >= part[0]) & (t <= part[1])
        t, lines = t[kept], [replace(line, y=line.y[kept]) for line in lines]
    return Panel(CHANNEL_WORDS.get(o.channel, o.channel), t, tuple(lines), height=150)


def _shown(o: TimeHistory, changed: bool) -> tuple[float, str]:
    """(factor of the shown unit, what the simulation before is called)."""
    return 180 / np.pi if o.channel in DEGREES else 1.0, "before" if changed else "model"


def run_and_spectra(channels: Sequence[TimeHistory], changed: bool = True) -> Chart:
    """The signals of one run beside the spectra of their residuals, a row for each channel."""
    start = Stack(
        channels[0].run,
        "time, s",
        tuple(_signal(o, changed) for o in channels),
        (0.0, max(float(o.t[-1] - o.t[0]) for o in channels)),
    )
    return Chart((start, *_spectra_stack(channels, changed)), columns=2)


def _spectra_stack(channels: Sequence[TimeHistory], changed: bool) -> list[Stack]:
    spectra = [o for o in channels if o.w.size > 1]
    if not spectra:
        return []
    span = 0.97 * float(min(o.w[0] for o in spectra)), 1.03 * float(max(o.w[-1] for o in spectra))
    shown = tuple(_spectrum(o, changed) for o in spectra)
    return [Stack("Residual over frequency", "frequency, rad/s", shown, span, "log")]


def _spectrum(o: TimeHistory, changed: bool) -> Panel:
    before, after = np.sqrt(o.residual_before), np.sqrt(o.residual_after)
    lines = [Curve("before" if changed else "model", before, **BEFORE)]
    lines += [Curve("after", after, **AFTER)] if changed else []
    seen = np.concatenate([line.y[np.isfinite(line.y)] for line in lines])
    limits = (0.0, max(1.1 * float(seen.max(initial=0.0)), 3.0))
    return Panel(
        f"{channel(o.channel)}, times noise", o.w, tuple(lines), limits=limits, levels=(1.0,), height=110
    )


# The part of a run where before and after differ most.


CLOSE_UP, SHORTEST = 5.0, 1.2  # s, longest (a quarter of the slowest motion) and shortest close-up
SWINGS = 5.0  # periods shown in a close-up


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


# A place where simulation and recording differ: the residual over what it depends on.


SMALL = 460  # px
REST = "#9CC3DF"
OVER = {
    "harmonic": "harmonic of the steering frequency",
    "amplitude": "largest steering angle",
    "time": "time in the run",
    "run": "",
}


def drawable(m: Mismatch, overlays: Sequence[TimeHistory]) -> bool:
    """True if the mismatch has a profile or a spectrum to draw."""
    return bool(m.profile and m.profile.ratio) or bool(_spectra(m, overlays))


def mismatch_chart(m: Mismatch, overlays: Sequence[TimeHistory]) -> Chart:
    """The residual over its profile's quantity if it has one, else over frequency; 1: noise floor."""
    made = _of_profile(m, m.profile) if m.profile and m.profile.ratio else _of_spectra(m, overlays)
    return Chart((made,), width=SMALL)


def _spectra(m: Mismatch, overlays: Sequence[TimeHistory]) -> list[TimeHistory]:
    return [o for o in overlays if o.channel == m.channel and o.w.size > 1]


def _of_profile(m: Mismatch, profile: Profile) -> Stack:
    """Bars for words and for few values, darker for those named in the condition; else a line."""
    y, labels = np.array(profile.ratio, dtype=float), _labels(profile)
    unit = f", {profile.unit.replace('us', 'µs')}" if profile.unit else ""
    words = f"{OVER.get(profile.over, profile.over)}{unit}"
    if labels:
        named = np.array([one in m.condition.split() or f"{one} " in m.condition for one in labels])
        named = named if named.any() else ~named
        lines = (
            Curve("residual", np.where(named, y, np.nan), BEFORE["colour"], bars=True),
            Curve("residual", np.where(named, np.nan, y), REST, bars=True),
        )
        across = Stack(words, words, (), (-0.6, len(labels) - 0.4), "words", labels=tuple(labels))
        return _levelled(m, across, np.arange(y.size, dtype=float), lines)
    x = np.array(profile.x, dtype=float)
    lines = (Curve("residual", y, BEFORE["colour"]), Curve("residual", y, BEFORE["colour"], dots=True))
    if profile.over != "frequency":
        return _levelled(m, Stack(words, words, (), (float(x.min()), float(x.max()))), x, lines)
    span = 0.9 * float(x.min()), 1.1 * float(x.max())
    return _levelled(m, Stack(words, words, (), span, "log", (_band(m),)), x, lines)


def _of_spectra(m: Mismatch, overlays: Sequence[TimeHistory]) -> Stack:
    spectra = _spectra(m, overlays)
    w = max((o.w for o in spectra), key=len)
    colours = [BEFORE["colour"], AFTER["colour"]] + ["#777777"] * len(spectra)
    lines = tuple(
        Curve(o.run, np.interp(w, o.w, np.sqrt(o.residual_before), np.nan, np.nan), colour)
        for o, colour in zip(spectra, colours, strict=False)
    )
    span = 0.95 * float(w[0]), 1.05 * float(w[-1])
    return _levelled(m, Stack("", "frequency, rad/s", (), span, "log", (_band(m),)), w, lines)


def _levelled(m: Mismatch, across: Stack, x: Array, lines: tuple[Curve, ...]) -> Stack:
    """The panel of one mismatch, with lines at the noise floor."""
    seen = np.concatenate([line.y[np.isfinite(line.y)] for line in lines])
    low, high = float(seen.min(initial=0.0)), float(seen.max(initial=1.0))
    words = "mean / its uncertainty" if m.condition == "steady" else "residual / noise"
    words = "fitted, to the left / noise" if m.condition.startswith("heading ") else words
    levels = (-1.0, 1.0) if low < 0 else (1.0,)
    limits = (1.08 * low, 1.08 * high)
    return replace(
        across, title=channel(m.channel), panels=(Panel(words, x, lines, (), limits, levels, 110),)
    )


def _band(m: Mismatch) -> tuple[float, float, str]:
    """The shaded band; 0 rad/s is the left end of the logarithmic axis."""
    return max(m.band[0], 1e-3), max(m.band[1], 1e-3), SHADE


def _labels(profile: Profile) -> list[str]:
    """Labels under the bars; none if the profile is drawn as a line."""
    if profile.over == "harmonic":
        return [ordinal(round(float(k))) for k in profile.x]
    if all(isinstance(x, str) for x in profile.x):
        return [str(x) for x in profile.x]
    digits = {"amplitude": 1, "speed": 2}.get(profile.over)
    return [] if digits is None else [f"{round(float(x), digits):g}" for x in profile.x]


# Fitted laws with their bands, and the straight line of those with a name.


def curves_chart(curves: Sequence[LawCurve]) -> Chart:
    """A panel for each curve."""
    return Chart(tuple(_curve(curve) for curve in curves), min(len(curves), 2))


def _curve(curve: LawCurve) -> Stack:
    own, turn = np.array(curve.x), int(np.argmax(curve.x)) + 1
    x = np.unique(own)

    def branches(values: Sequence[float]) -> list[Array]:
        """The way up, and the way back of a curve with a loop, over the same x."""
        y = np.array(values)
        parts = [(own[:turn], y[:turn])]
        parts += [(own[turn - 1 :][::-1], y[turn - 1 :][::-1])] if turn < own.size else []
        return [np.interp(x, *part, np.nan, np.nan) for part in parts]

    lines = [Curve("fitted law", y, AFTER["colour"]) for y in branches(curve.y)]
    bands = zip(branches(curve.low), branches(curve.high), strict=True)
    spreads = tuple(Spread("90 % interval", low, high, "#F2CE8B") for low, high in bands)
    if not curve.gain:  # of a law with a name
        lines.append(
            Curve("straight line", np.array(curve.straight(list(x))), "#333333", dash=(4, 2), width=1.0)
        )
    resonance = curve.memory == "resonance"
    if resonance:
        title, over = f"{curve.place}: resonance of {curve.over} at {curve.size:.2g} Hz", "frequency"
    else:
        title = f"{curve.place}{f', times {curve.times}' if curve.times else ''}"
        over = f"{curve.over}{f' ({curve.memory} of {curve.size:.3g})' if curve.memory else ''}"
    panel = Panel(curve.unit, x, tuple(lines), spreads, levels=(0.0,), height=190)
    span = (float(x[0]), float(x[-1]))
    return Stack(title, f"{over}, {curve.over_unit}", (panel,), span, "log" if resonance else "linear")


# Responses of recording and simulation, before and after, over each other.


def bode_chart(responses: Sequence[Bode]) -> Chart:
    """Magnitude, phase and coherence of each response; outside of the coherent band shaded."""
    return Chart(tuple(_stack(b) for b in responses), columns=2)


def _stack(b: Bode) -> Stack:
    low, high = b.band or (float(b.w[0]), float(b.w[-1]))
    first = int(np.argmax((b.w >= low * 0.999) & (b.w <= high * 1.001)))
    recorded: dict[str, Any] = {"colour": DATA, "width": 2.0}
    lines = (("recorded", b.recorded, recorded), ("before", b.before, BEFORE), ("after", b.after, AFTER))
    db, deg = [], []
    for name, h, style in lines:
        phase = np.degrees(np.unwrap(np.angle(h)))
        db.append(Curve(name, 20 * np.log10(np.maximum(np.abs(h), 1e-9)), **style))
        deg.append(Curve(name, phase - 360.0 * np.round(float(phase[first]) / 360.0), **style))
    return bode_stack(
        f"{OUTPUT_NAMES.get(b.output, b.output)} / steering",
        b.w,
        b.band,
        tuple(db),
        tuple(deg),
        Curve("coherence", b.coherence, DATA),
        heights=(150, 130, 70),
    )
