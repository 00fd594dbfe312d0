"""Frequency responses with coherence (Figure 3 of the paper), and with the models over them (Figure 6)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator

from rover_sweep.data.recording import Array
from rover_sweep.identification.cost import costs
from rover_sweep.identification.grouping import Group
from rover_sweep.identification.pipeline import ModelResult
from rover_sweep.report.pictures.style import (
    BAND,
    DATA,
    LABELS,
    OUTSIDE,
    WIDTH,
    limits,
    log_frequency,
    model_line,
)
from rover_sweep.report.wording.number_format import band
from rover_sweep.spectra.response import COHERENCE_GOOD, FrequencyResponse
from rover_sweep.spectra.unwrapped import inside_band as _inside
from rover_sweep.spectra.unwrapped import nearest_turn as _nearest_turn
from rover_sweep.spectra.unwrapped import unwrapped_phase as _phase
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
