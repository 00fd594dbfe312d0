"""A design as text for the terminal, and as JSON."""

from __future__ import annotations

import json
import math
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from rover_sweep.cli.views.display import blocks, bullet, fact, ruler
from rover_sweep.cli.views.output import echo, echo_json
from rover_sweep.data.braille import braille_lines
from rover_sweep.data.geometry import GRAVITY
from rover_sweep.data.vehicle_file import Vehicle
from rover_sweep.design.demand import (
    DOUBLET_PEAK,
    SERVO_60_DEG,
    TRIM_ERROR,
    Design,
    ServoDemand,
    Space,
    Windows,
    simulated_track,
    spectrum_grid,
    wave,
    wave_spectrum,
)
from rover_sweep.errors import UsageError
from rover_sweep.manoeuvre.multisine import Multisine
from rover_sweep.manoeuvre.sweep import Doublet, Sweep

WIDTH = 63
SPAN_DB = 40.0


def show_json(design: Design) -> None:
    """Print all numbers as JSON on stdout; units as in the docstrings of Design."""
    echo_json(json.dumps(asdict(design), indent=2))


def show_design(design: Design, vehicle: Vehicle | None) -> None:
    """Print the design on stdout: plots, a table of facts, and notes."""
    echo(_title(design) + "\n")
    if _can_draw():
        echo("\n".join(_wave_lines(design)) + "\n")
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


def _can_draw() -> bool:
    return "utf" in (sys.stdout.encoding or "").lower()


def _title(design: Design) -> str:
    m = design.manoeuvre
    if isinstance(m, Doublet):
        return f"{m.count} doublets, {m.amplitude:g} us, steps of {m.pulse:g} s"
    hertz = f"{m.w_min / 2 / math.pi:.2g}..{m.w_max / 2 / math.pi:.2g} Hz"
    what = "Multisine, peak" if isinstance(m, Multisine) else "Sweep,"
    about = f" about {m.middle:+g} us" if isinstance(m, Sweep) and m.middle else ""
    return f"{what} {m.amplitude:g} us{about}, {m.w_min:g}..{m.w_max:g} rad/s ({hertz}) in {m.t_rec:g} s"


def _wave_lines(design: Design) -> list[str]:
    m = design.manoeuvre
    t, x = wave(m)
    drawn = braille_lines([(t, x)], (t[0], t[-1]), (-m.peak, m.peak), WIDTH, 6)
    names = [f"{m.peak:+g} us", "", "", "", "", f"{-m.peak:+g} us"]
    lines = [f"  {name:>8} {line}" for name, line in zip(names, drawn, strict=True)]
    step = 10 if m.duration > 30 else 2 if m.duration > 8 else 1
    ticks = [(t / m.duration, f"{t:g}") for t in np.arange(0, m.duration, step)]
    lines.append(f"  {'s':>8} {ruler(ticks, WIDTH)}")
    if isinstance(m, Sweep):
        marks = [(float(t) / m.duration, f"{float(m.rate(t - m.law_start)):.2g}") for t in _law_times(m)]
        lines.append(f"  {'rad/s':>8} {ruler(marks, WIDTH)}")
    return lines


def _law_times(sweep: Sweep) -> list[float]:
    return [sweep.law_start + sweep.t_rec * share / 6 for share in range(7)]


def _spectrum_lines(design: Design) -> list[str]:
    w = spectrum_grid(design, WIDTH)
    db = 20 * np.log10(np.maximum(wave_spectrum(design.manoeuvre, w), 1e-9))
    top = float(db.max())
    span = math.log(w[-1] / w[0])
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
    facts = [("one run", _duration(design)), ("", "plus the standstill before and after it")]
    if isinstance(design.manoeuvre, Sweep) and design.windows:
        facts.append(
            (
                "long periods",
                f"{design.runs * (design.long_periods or 0.0):.1f} of {design.manoeuvre.w_min:g} rad/s in "
                f"{'the T_rec of all runs' if design.runs > 1 else 'T_rec'} (4..5 advised)",
            )
        )
    if isinstance(design.manoeuvre, Multisine):
        facts += _line_facts(design.manoeuvre)
    if design.windows:
        facts += _window_facts(design.windows, design.runs)
    if isinstance(design.manoeuvre, Doublet):
        pulse = design.manoeuvre.pulse
        band = f"peak at {DOUBLET_PEAK / pulse:.2g} rad/s, zero at {2 * math.pi / pulse:.2g} rad/s"
        facts.append(("excites", band))
    facts += _servo_facts(design.servo)
    facts += _space_facts(design.space) if design.space else [("space", _why_no_space(vehicle))]
    rates = design.rates
    facts.append(
        (
            "sampling",
            f"{rates.least:.0f} Hz at least, {rates.good:.0f} Hz good ({design.w_top / 2 / math.pi:.1f} "
            f"Hz x 10, x 20)",
        )
    )
    loop = f"SCHED_LOOP_RATE {rates.loop:g}: log {rates.loop:g} Hz, telemetry up to {rates.stream:.0f} Hz"
    facts.append(("", loop + (f"; {rates.loop_needed} is sufficient" if rates.loop_needed else "")))
    for number, effect in enumerate(design.filters):
        lag = f"gain {effect.gain:.2f}, lag {effect.lag_deg:.0f} deg ({effect.lag_ms:.0f} ms)"
        text = f"{effect.parameter} {effect.cutoff_hz:g} Hz: {lag}"
        facts.append(("" if number else f"at {design.w_top:.3g} rad/s", text))
    return facts


def _line_facts(m: Multisine) -> list[tuple[str, str]]:
    lines = (
        f"{m.lines.size} excited, odd multiples of {m.base:.3g} rad/s, {m.periods} periods of "
        f"{m.t_rec / m.periods:.3g} s; crest factor {m.crest_factor:.1f}"
    )
    kept = (
        f"2nd harmonics at {m.even.size} even lines, 3rd harmonics at {m.odd_left_out.size} unused odd lines"
    )
    return [("lines", lines), ("", kept)]


def _duration(design: Design) -> str:
    m = design.manoeuvre
    if isinstance(m, Doublet):
        each = f"({m.pulse:g} + {m.pulse:g} + pause {m.pause:g})"
        return f"{m.duration:g} s: straight {m.straight:g}, {m.count} x {each}, straight {m.straight:g}"
    return (
        f"{m.duration:g} s: straight {m.straight:g}, fade {m.fade:g}, dwell {m.dwell:g}, T_rec {m.t_rec:g}, "
        f"fade {m.fade:g}, straight {m.straight:g}"
    )


def _window_facts(windows: Windows, runs: int) -> list[tuple[str, str]]:
    lengths = ", ".join(f"{length:.1f}" for length in windows.lengths)
    rule = (
        f"rule: 20 periods of w_max to min(T_rec/2, all runs/5) = {windows.t_min:.1f}..{windows.t_max:.1f} s"
    )
    longest, resolves = max(windows.lengths), f"the longest resolves {windows.lowest:.2f} rad/s"
    if longest > 1.001 * windows.t_max:
        resolves = f"the longest exceeds it to include w_min, and resolves {windows.lowest:.2f} rad/s"
    return [("windows", f"{lengths} s for {runs} run{'s' if runs > 1 else ''}"), ("", f"{rule}; {resolves}")]


def _servo_facts(servo: ServoDemand) -> list[tuple[str, str]]:
    typical = f"{60 / SERVO_60_DEG[1]:.0f}..{60 / SERVO_60_DEG[0]:.0f} deg/s"
    if servo.us_s is None or servo.horn_deg_s is None:
        facts = [
            ("servo", f"{1000 * servo.step_s[0]:.0f}..{1000 * servo.step_s[1]:.0f} ms from peak to peak")
        ]
    else:
        facts = [
            ("servo", f"{servo.us_s:.0f} us/s, {servo.horn_deg_s:.0f} deg/s at the horn (typical: {typical})")
        ]
    if servo.wheel_deg is not None:
        rate = f", {servo.wheel_deg_s:.0f} deg/s" if servo.wheel_deg_s else ""
        facts.append(("road wheels", f"{servo.wheel_deg:.1f} deg{rate} at the peak"))
    return facts


def _space_facts(space: Space) -> list[tuple[str, str]]:
    sides = {"forward": space.forward, "back": space.back, "left": space.left, "right": space.right}
    reach = ", ".join(f"{name} {metres:.0f}" for name, metres in sides.items())
    turning = f"turning radius {space.radius:.1f} m, heading over {space.heading_deg:.0f} deg"
    sideways = f"{space.ay:.2g} m/s^2 = {space.ay / GRAVITY:.2f} g sideways"
    return [
        ("space", f"{space.length:.0f} x {space.width:.0f} m at {space.speed:g} m/s: {reach} m of the start"),
        ("", f"{space.path:.0f} m driven, {turning}"),
        ("at the peak", f"yaw rate {space.yaw_rate_deg_s:.0f} deg/s, {sideways} (tyre limit 0.5..0.9 g)"),
    ]


def _why_no_space(vehicle: Vehicle | None) -> str:
    return "unknown; give " + ("--speed" if vehicle else "--vehicle rover.toml and --speed")


# Figure of a design: wave, frequency, spectrum, and the track on the ground.


def draw_design(design: Design, vehicle: Vehicle | None, path: Path) -> None:
    """Write the figure to `path`; the suffix gives the format. UsageError if it cannot be written."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 8 if design.space else 6.5), layout="constrained")
    wave_axes, middle, *ground = figure.subplots(3 if design.space else 2, 1)
    left, right = _split(figure, middle) if isinstance(design.manoeuvre, Sweep) else (None, middle)
    _draw_wave(wave_axes, design)
    if left is not None:
        _draw_frequency(left, design)
    _draw_spectrum(right, design)
    if design.space and vehicle:
        _draw_track(ground[0], design, vehicle, design.space.speed)
    try:
        figure.savefig(path, dpi=120)
    except (OSError, ValueError) as error:
        raise UsageError(f"the picture {path} cannot be written: {error}") from None


def _split(figure: Any, axes: Any) -> tuple[Any, Any]:
    """Two axes side by side instead of one."""
    spec = axes.get_subplotspec().subgridspec(1, 2)
    axes.remove()
    return figure.add_subplot(spec[0]), figure.add_subplot(spec[1])


def _draw_wave(axes: Any, design: Design) -> None:
    t, x = wave(design.manoeuvre)
    axes.plot(t, x, linewidth=0.8)
    axes.set(xlabel="time of the override, s", ylabel="steering offset, us", xlim=(0, t[-1]))
    axes.set_title(f"{design.manoeuvre.kind.replace('_', ' ')}, {design.manoeuvre.amplitude:g} us")
    axes.grid(alpha=0.3)


def _draw_frequency(axes: Any, design: Design) -> None:
    sweep = design.manoeuvre
    assert isinstance(sweep, Sweep)
    t = np.linspace(sweep.straight, sweep.duration - sweep.straight, 500)
    axes.semilogy(t, sweep.rate(t - sweep.law_start))
    axes.axvspan(sweep.law_start, sweep.law_start + sweep.t_rec, alpha=0.1, label="T_rec")
    axes.set(xlabel="time of the override, s", ylabel="frequency, rad/s")
    axes.legend(loc="upper left")
    axes.grid(alpha=0.3, which="both")


def _draw_spectrum(axes: Any, design: Design) -> None:
    w = spectrum_grid(design, 400)
    axes.semilogx(w, 20 * np.log10(wave_spectrum(design.manoeuvre, w)))
    if not isinstance(design.manoeuvre, Doublet):
        axes.axvspan(design.manoeuvre.w_min, design.manoeuvre.w_max, alpha=0.1)
    axes.set(xlabel="frequency, rad/s", ylabel="spectrum, dB")
    axes.grid(alpha=0.3, which="both")


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
