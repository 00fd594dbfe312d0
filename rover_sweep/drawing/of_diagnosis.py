"""`FullDiagnosis.plot`: a run measured and simulated; `.plot_curves`: the fitted laws."""

from __future__ import annotations

from typing import Any

from rover_sweep.diagnosis.result import Diagnosis, LawCurve, Overlay
from rover_sweep.drawing.axes import panels
from rover_sweep.errors import UsageError
from rover_sweep.report.pictures.law_curves import HEIGHT, draw_curve
from rover_sweep.report.pictures.overlay import draw_overlay, draw_residual
from rover_sweep.report.pictures.style import WIDTH, literal
from rover_sweep.report.wording.effect_names import LONG_CHANNELS

ROW = 2.0  # in


def draw_diagnosis(found: Diagnosis, run: str | None, axes: Any) -> Any:
    """Axes (channels, 2): the signals over time, and the spectrum of the residual over the noise."""
    channels = _channels(found, run)
    changed = bool(found.findings)
    names = [f"{what} of {o.channel}" for o in channels for what in ("signal", "residual")]
    shape, size = (len(channels), 2), (WIDTH, 0.7 + ROW * len(channels))
    with panels(axes, shape, names, size, width_ratios=(2.3, 1)) as given:
        for k, (row, o) in enumerate(zip(given, channels, strict=True)):
            draw_overlay(row[0], o, changed, last=k == len(channels) - 1)
            draw_residual(row[1], o, changed)
            row[0].set_ylabel(LONG_CHANNELS.get(o.channel, o.channel))
        role = "held out" if channels[0].held_out else "used in the fit"
        given[0, 0].set_title(f"{literal(channels[0].run)}, {role}")
        given[0, 0].legend(fontsize="small", ncols=4)
        given[0, 1].set_title("residual / noise")
        given[-1, 0].set_xlabel("time, s")
        given[-1, 1].set_xlabel("frequency, rad/s")
    return given


def draw_curves(curves: tuple[LawCurve, ...], axes: Any) -> Any:
    """Axes (n,): each law over its quantity, with its band."""
    if not curves:
        raise UsageError("this diagnosis has no curves: its model has no tyres, or it was refused")
    names = [curve.place for curve in curves]
    with panels(axes, (1, len(curves)), names, (0.5 * WIDTH * len(curves), HEIGHT)) as given:
        for curve, panel in zip(curves, given.ravel(), strict=True):
            draw_curve(curve, panel)
    return given.ravel()


def _channels(found: Diagnosis, run: str | None) -> list[Overlay]:
    """The overlays of a run; by default of the first held-out run, else of the first one."""
    drawn = [o for o in found.overlays if o.t.size > 1]
    if not drawn:
        raise UsageError(
            "this diagnosis holds no signals to draw (neither has a diagnosis.json); "
            "load the file that FullDiagnosis.save wrote"
        )
    names = list(dict.fromkeys(o.run for o in drawn))
    chosen = run or next((o.run for o in drawn if o.held_out), names[0])
    if chosen not in names:
        raise UsageError(f"there is no run {chosen!r} in this diagnosis; it has {', '.join(names)}")
    return [o for o in drawn if o.run == chosen]
