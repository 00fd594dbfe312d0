"""A small picture of one mismatch: how large the residual is over what it depends on."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rover_sweep.diagnosis.result import Mismatch, Overlay, Profile
from rover_sweep.report.overlay_picture import AFTER, BEFORE, SHADE
from rover_sweep.report.picture_style import OUTSIDE, log_frequency

SIZE = (5.2, 2.3)  # in


def drawable(m: Mismatch, overlays: Sequence[Overlay]) -> bool:
    """Is there anything to draw for it."""
    return m.profile is not None or bool(_spectra(m, overlays))


def mismatch(m: Mismatch, overlays: Sequence[Overlay]) -> Figure:
    """The residual over its profile where there is one, else over frequency; 1 is the noise floor."""
    figure = Figure(figsize=SIZE)
    axes = figure.add_axes((0.115, 0.235, 0.865, 0.735))
    if m.profile is None:
        _frequency(axes, m, _spectra(m, overlays))
    else:
        _profile(axes, m.profile)
        if m.profile.over == "frequency":
            _shade(axes, m.band)
    axes.axhline(1.0, color="#555555", linewidth=1.0, linestyle=(0, (4, 2)))
    axes.set_ylim(bottom=0)
    axes.set_ylabel("residual / noise")
    axes.text(0.995, 1.0, "noise floor", transform=axes.get_yaxis_transform(), ha="right", va="bottom",
              fontsize=8, color="#555555")  # fmt: skip
    return figure


def _spectra(m: Mismatch, overlays: Sequence[Overlay]) -> list[Overlay]:
    return [o for o in overlays if o.channel == m.channel and o.w.size > 1]


def _profile(axes: Axes, profile: Profile) -> None:
    if not profile.x or isinstance(profile.x[0], str):
        axes.bar(range(len(profile.x)), profile.ratio, color=BEFORE["color"], width=0.55)
        axes.set_xticks(range(len(profile.x)), [str(x) for x in profile.x])
        axes.set_xlim(-0.6, len(profile.x) - 0.4)
        axes.grid(axis="x", visible=False)
    else:
        axes.plot(profile.x, profile.ratio, color=BEFORE["color"], marker="o", markersize=4)
    unit = f", {profile.unit.replace('us', 'µs')}" if profile.unit else ""
    axes.set_xlabel(f"{profile.over}{unit}")
    if profile.over == "frequency":
        x = [float(v) for v in profile.x]
        log_frequency(axes, 0.9 * min(x), 1.1 * max(x), labelled=True)


def _frequency(axes: Axes, m: Mismatch, spectra: Sequence[Overlay]) -> None:
    low, high = min(o.w[0] for o in spectra), max(o.w[-1] for o in spectra)
    for k, o in enumerate(spectra):
        colour = BEFORE["color"] if k == 0 else AFTER["color"] if k == 1 else OUTSIDE
        axes.plot(o.w, np.sqrt(o.residual_before), color=colour, label=o.run, alpha=0.9)
    _shade(axes, m.band)
    log_frequency(axes, 0.95 * float(low), 1.05 * float(high), labelled=True)
    if len(spectra) > 1:
        axes.legend(fontsize=8)


def _shade(axes: Axes, band: tuple[float, float]) -> None:
    """Marks a band of frequencies; from 0 rad/s on means from the left end of the logarithmic axis."""
    axes.axvspan(max(band[0], 1e-3), band[1], color=SHADE, linewidth=0, zorder=0)
