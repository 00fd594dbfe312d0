"""The curves of unknown laws with their bands, and the held-out runs without and with them."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rover_sweep.diagnosis.result import LawCurve, LawHeldOut
from rover_sweep.report.pictures.style import BAND, MODEL_LINES, WIDTH, literal

HEIGHT = 3.4  # in
BEFORE, AFTER = "#BDBDBD", "#D55E00"


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
    axes.bar(at - 0.2, [h.before for h in runs], 0.38, color=BEFORE, label="without")
    axes.bar(
        at + 0.2, [h.after for h in runs], 0.38, color=AFTER, hatch="//", edgecolor="white", label="with"
    )
    axes.axhline(1.0, color="#333333", linestyle=(0, (4, 2)), linewidth=1.0, label="noise")
    axes.set_xticks(at, [literal(h.run) for h in runs])
    axes.set_title("held-out runs: mean square over noise")
    axes.grid(axis="x", visible=False)
    axes.legend()
