"""A design as text for the terminal, and as JSON."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import Any

import numpy as np

from rover_sweep.cli.views.display import blocks, bullet, fact
from rover_sweep.cli.views.output import echo
from rover_sweep.data.braille import braille_lines, ruler
from rover_sweep.data.geometry import GRAVITY
from rover_sweep.data.vehicle_file import Vehicle
from rover_sweep.design.demand import (
    DOUBLET_PEAK,
    SERVO_60_DEG,
    TRIM_ERROR,
    Design,
    simulated_track,
    spectrum_grid,
    wave,
    wave_spectrum,
)
from rover_sweep.errors import UsageError
from rover_sweep.manoeuvre.multisine import Multisine
from rover_sweep.manoeuvre.sweep import Doublet, Manoeuvre, Sweep

WIDTH = 63
SPAN_DB = 40.0


def show_design(design: Design, vehicle: Vehicle | None) -> None:
    """Print the design on stdout: plots, a table of facts, and notes."""
    m = design.manoeuvre
    if isinstance(m, Doublet):
        title = f"{m.count} doublets, {m.amplitude:g} us, steps of {m.pulse:g} s"
    else:
        hertz = f"{m.w_min / 2 / math.pi:.2g}..{m.w_max / 2 / math.pi:.2g} Hz"
        what = "Multisine, peak" if isinstance(m, Multisine) else "Sweep,"
        about = f" about {m.middle:+g} us" if isinstance(m, Sweep) and m.middle else ""
        band = f"{m.w_min:g}..{m.w_max:g} rad/s ({hertz})"
        title = f"{what} {m.amplitude:g} us{about}, {band} in {m.t_rec:g} s"
    echo(title + "\n")
    if "utf" in (sys.stdout.encoding or "").lower():
        echo("\n".join(_wave_lines(m)) + "\n")
        echo("\n".join(_spectrum_lines(design)) + "\n")
    for name, text in _facts(design, vehicle):
        echo(fact(name, text))
    if design.notes:
        echo("\nMind")
    for level, mark in (("warning", "!"), ("info", "-")):
        for note in design.notes:
            if note.level == level:
                echo(bullet(mark, note.text))
    if not any(note.level == "warning" for note in design.notes):
        echo("\nNo problems found.")


def _wave_lines(m: Manoeuvre) -> list[str]:
    t, x = wave(m)
    drawn = braille_lines([(t, x)], (t[0], t[-1]), (-m.peak, m.peak), WIDTH, 6)
    names = [f"{m.peak:+g} us", "", "", "", "", f"{-m.peak:+g} us"]
    lines = [f"  {name:>8} {line}" for name, line in zip(names, drawn, strict=True)]
    step = 10 if m.duration > 30 else 2 if m.duration > 8 else 1
    ticks = [(t / m.duration, f"{t:g}") for t in np.arange(0, m.duration, step)]
    lines.append(f"  {'s':>8} {ruler(ticks, WIDTH)}")
    if isinstance(m, Sweep):
        times = [m.law_start + m.t_rec * share / 6 for share in range(7)]
        marks = [(float(t) / m.duration, f"{float(m.rate(t - m.law_start)):.2g}") for t in times]
        lines.append(f"  {'rad/s':>8} {ruler(marks, WIDTH)}")
    return lines


def _spectrum_lines(design: Design) -> list[str]:
    w = spectrum_grid(design, WIDTH)
    db = 20 * np.log10(np.maximum(wave_spectrum(design.manoeuvre, w), 1e-9))
    top, span = float(db.max()), math.log(w[-1] / w[0])
    ticks = [
        (math.log(x / w[0]) / span, f"{x:g}")
        for x in (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100)
        if w[0] <= x <= w[-1]
    ]
    return [
        f"  {'spectrum':>8} {blocks(db, top - SPAN_DB, top)} {SPAN_DB:g} dB",
        f"  {'rad/s':>8} {ruler(ticks, WIDTH)}",
    ]


def _facts(design: Design, vehicle: Vehicle | None) -> list[tuple[str, str]]:
    m, runs = design.manoeuvre, design.runs
    if isinstance(m, Doublet):
        each = f"({m.pulse:g} + {m.pulse:g} + pause {m.pause:g})"
        parts = f"straight {m.straight:g}, {m.count} x {each}, straight {m.straight:g}"
    else:
        ends = f"straight {m.straight:g}, fade {m.fade:g}"
        parts = f"{ends}, dwell {m.dwell:g}, T_rec {m.t_rec:g}, fade {m.fade:g}, straight {m.straight:g}"
    facts = [("one run", f"{m.duration:g} s: {parts}"), ("", "plus the standstill before and after it")]
    if isinstance(m, Sweep) and design.windows:
        of = "the T_rec of all runs" if runs > 1 else "T_rec"
        periods = f"{runs * (design.long_periods or 0.0):.1f} of {m.w_min:g} rad/s in {of} (4..5 advised)"
        facts.append(("long periods", periods))
    if isinstance(m, Multisine):
        lines = (
            f"{m.lines.size} excited, odd multiples of {m.base:.3g} rad/s, {m.periods} periods of "
            f"{m.t_rec / m.periods:.3g} s; crest factor {m.crest_factor:.1f}"
        )
        even, odd = f"{m.even.size} even lines", f"{m.odd_left_out.size} unused odd lines"
        facts += [("lines", lines), ("", f"2nd harmonics at {even}, 3rd harmonics at {odd}")]
    if windows := design.windows:
        lengths = ", ".join(f"{length:.1f}" for length in windows.lengths)
        span = f"{windows.t_min:.1f}..{windows.t_max:.1f} s"
        resolves = f"the longest resolves {windows.lowest:.2f} rad/s"
        if max(windows.lengths) > 1.001 * windows.t_max:
            resolves = f"the longest exceeds it to include w_min, and resolves {windows.lowest:.2f} rad/s"
        facts.append(("windows", f"{lengths} s for {runs} run{'s' if runs > 1 else ''}"))
        rule = f"rule: 20 periods of w_max to min(T_rec/2, all runs/5) = {span}; {resolves}"
        facts.append(("", rule))
    if isinstance(m, Doublet):
        band = f"peak at {DOUBLET_PEAK / m.pulse:.2g} rad/s, zero at {2 * math.pi / m.pulse:.2g} rad/s"
        facts.append(("excites", band))
    servo = design.servo
    if servo.us_s is None or servo.horn_deg_s is None:
        words = f"{1000 * servo.step_s[0]:.0f}..{1000 * servo.step_s[1]:.0f} ms from peak to peak"
    else:
        typical = f"typical: {60 / SERVO_60_DEG[1]:.0f}..{60 / SERVO_60_DEG[0]:.0f} deg/s"
        words = f"{servo.us_s:.0f} us/s, {servo.horn_deg_s:.0f} deg/s at the horn ({typical})"
    facts.append(("servo", words))
    if servo.wheel_deg is not None:
        rate = f", {servo.wheel_deg_s:.0f} deg/s" if servo.wheel_deg_s else ""
        facts.append(("road wheels", f"{servo.wheel_deg:.1f} deg{rate} at the peak"))
    if space := design.space:
        sides = {"forward": space.forward, "back": space.back, "left": space.left, "right": space.right}
        reach = ", ".join(f"{name} {metres:.0f}" for name, metres in sides.items())
        ground = f"{space.length:.0f} x {space.width:.0f} m at {space.speed:g} m/s"
        turning = f"turning radius {space.radius:.1f} m, heading over {space.heading_deg:.0f} deg"
        sideways = f"{space.ay:.2g} m/s^2 = {space.ay / GRAVITY:.2f} g sideways (tyre limit 0.5..0.9 g)"
        facts.append(("space", f"{ground}: {reach} m of the start"))
        facts.append(("", f"{space.path:.0f} m driven, {turning}"))
        facts.append(("at the peak", f"yaw rate {space.yaw_rate_deg_s:.0f} deg/s, {sideways}"))
    else:
        needed = "--speed" if vehicle else "--vehicle rover.toml and --speed"
        facts.append(("space", f"unknown; give {needed}"))
    rates, hertz = design.rates, f"{design.w_top / 2 / math.pi:.1f} Hz x 10, x 20"
    facts.append(("sampling", f"{rates.least:.0f} Hz at least, {rates.good:.0f} Hz good ({hertz})"))
    loop = f"SCHED_LOOP_RATE {rates.loop:g}: log {rates.loop:g} Hz, telemetry up to {rates.stream:.0f} Hz"
    facts.append(("", loop + (f"; {rates.loop_needed} is sufficient" if rates.loop_needed else "")))
    for number, effect in enumerate(design.filters):
        lag = f"gain {effect.gain:.2f}, lag {effect.lag_deg:.0f} deg ({effect.lag_ms:.0f} ms)"
        text = f"{effect.parameter} {effect.cutoff_hz:g} Hz: {lag}"
        facts.append(("" if number else f"at {design.w_top:.3g} rad/s", text))
    return facts


def draw_design(design: Design, vehicle: Vehicle | None, path: Path) -> None:
    """Write the figure to `path`; the suffix gives the format. UsageError if it cannot be written."""
    from matplotlib.figure import Figure

    m = design.manoeuvre
    figure = Figure(figsize=(10, 8 if design.space else 6.5), layout="constrained")
    whole, right, *ground = figure.subplots(3 if design.space else 2, 1)
    t, x = wave(m)
    whole.plot(t, x, linewidth=0.8)
    whole.set(xlabel="time of the override, s", ylabel="steering offset, us", xlim=(0, t[-1]))
    whole.set_title(f"{m.kind.replace('_', ' ')}, {m.amplitude:g} us")
    whole.grid(alpha=0.3)
    if isinstance(m, Sweep):  # the frequency beside the spectrum
        spec = right.get_subplotspec().subgridspec(1, 2)
        right.remove()
        left, right = figure.add_subplot(spec[0]), figure.add_subplot(spec[1])
        t = np.linspace(m.straight, m.duration - m.straight, 500)
        left.semilogy(t, m.rate(t - m.law_start))
        left.axvspan(m.law_start, m.law_start + m.t_rec, alpha=0.1, label="T_rec")
        left.set(xlabel="time of the override, s", ylabel="frequency, rad/s")
        left.legend(loc="upper left")
        left.grid(alpha=0.3, which="both")
    w = spectrum_grid(design, 400)
    right.semilogx(w, 20 * np.log10(wave_spectrum(m, w)))
    if not isinstance(m, Doublet):
        right.axvspan(m.w_min, m.w_max, alpha=0.1)
    right.set(xlabel="frequency, rad/s", ylabel="spectrum, dB")
    right.grid(alpha=0.3, which="both")
    if design.space and vehicle:
        _draw_track(ground[0], design, vehicle, design.space.speed)
    try:
        figure.savefig(path, dpi=120)
    except (OSError, ValueError) as error:
        raise UsageError(f"the picture {path} cannot be written: {error}") from None


def _draw_track(axes: Any, design: Design, vehicle: Vehicle, speed: float) -> None:
    for error, style in ((0.0, "-"), (-TRIM_ERROR, ":"), (TRIM_ERROR, "--")):
        path = simulated_track(design.manoeuvre, vehicle, speed, error)
        label = "trim exact" if error == 0 else f"trim {error:+g} us off"
        axes.plot(path.x, path.y, style, linewidth=1.5 if error == 0 else 0.9, label=label)
    axes.plot(0, 0, "ko", label="start")
    axes.set(xlabel="forward, m", ylabel="left, m", title=f"track at {speed:g} m/s (without corrections)")
    axes.set_aspect("equal", adjustable="datalim")
    axes.legend(fontsize="small")
    axes.grid(alpha=0.3)
