"""Figure of a design: wave, frequency, spectrum, and the track on the ground."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from rover_sweep.data.vehicle_file import Vehicle
from rover_sweep.design.demand import TRIM_ERROR, Design, simulated_track, spectrum_grid, wave, wave_spectrum
from rover_sweep.errors import UsageError
from rover_sweep.manoeuvre.sweep import Doublet, Sweep


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
