"""Models with the steering of a verification run as input, as Figure 7 of the paper."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rover_sweep.data.recording import Recording
from rover_sweep.identification.verify import Overlay, Verification
from rover_sweep.report.pictures.style import DATA, LABELS, WIDTH, model_line


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
