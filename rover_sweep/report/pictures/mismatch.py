"""A small picture of one mismatch: the residual against the quantity that it depends on."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rover_sweep.diagnosis.locate.residual_maps import ordinal
from rover_sweep.diagnosis.result import Mismatch, Overlay, Profile
from rover_sweep.report.pictures.overlay import AFTER, BEFORE, SHADE
from rover_sweep.report.pictures.style import OUTSIDE, literal, log_frequency

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


def drawable(m: Mismatch, overlays: Sequence[Overlay]) -> bool:
    """True if the mismatch has a profile or a spectrum to draw."""
    return _filled(m) is not None or bool(_spectra(m, overlays))


def mismatch(m: Mismatch, overlays: Sequence[Overlay]) -> Figure:
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


def _spectra(m: Mismatch, overlays: Sequence[Overlay]) -> list[Overlay]:
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


def _frequency(axes: Axes, m: Mismatch, spectra: Sequence[Overlay]) -> None:
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
