"""One run measured and simulated before and after, its residual, and the residual over frequency."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rover_sweep.diagnosis.result import Overlay
from rover_sweep.report.charts.chart import Chart, Curve, Panel, Stack
from rover_sweep.report.charts.colours import AFTER, BEFORE, CHANNEL_WORDS, DATA
from rover_sweep.report.wording.number_format import SHORT_NAMES


def overlay_chart(channels: Sequence[Overlay], changed: bool = True) -> Chart:
    """Time histories with residuals, then the spectra. changed: also the simulation after the findings."""
    run = channels[0]
    panels = [panel for o in channels for panel in _histories(o, changed)]
    start, end = 0.0, max(float(o.t[-1] - o.t[0]) for o in channels)
    stacks = [Stack(run.run, "time, s", tuple(panels), (start, end))]
    spectra = [o for o in channels if o.w.size > 1]
    if spectra:
        span = 0.97 * float(min(o.w[0] for o in spectra)), 1.03 * float(max(o.w[-1] for o in spectra))
        shown = tuple(_spectrum(o, changed) for o in spectra)
        stacks.append(Stack("Residual over frequency", "frequency, rad/s", shown, span, "log"))
    return Chart(tuple(stacks))


def _histories(o: Overlay, changed: bool) -> tuple[Panel, Panel]:
    f = 180 / np.pi if o.channel in ("r", "p") else 1.0
    t, noise = o.t - o.t[0], 2 * o.noise * f
    word = CHANNEL_WORDS.get(o.channel, o.channel)
    first = "before" if changed else "model"
    lines = [Curve("measured", o.measured * f, DATA, width=1.0), Curve(first, o.before * f, **BEFORE)]
    left = [Curve(f"residual {first}", (o.measured - o.before) * f, BEFORE["colour"], width=1.0)]
    if changed:
        lines.append(Curve("after", o.after * f, **AFTER))
        left.append(Curve("residual after", (o.measured - o.after) * f, AFTER["colour"], width=1.0))
    unit = word.rpartition(", ")[2]
    return (
        Panel(word, t, tuple(lines), height=150),
        Panel(f"residual, {unit}", t, tuple(left), levels=(-noise, noise), height=100),
    )


def _spectrum(o: Overlay, changed: bool) -> Panel:
    before, after = np.sqrt(o.residual_before), np.sqrt(o.residual_after)
    lines = [Curve("before" if changed else "model", before, **BEFORE)]
    lines += [Curve("after", after, **AFTER)] if changed else []
    top = max(float(np.nanmax(line.y)) for line in lines)
    limits = (0.0, max(1.1 * top, 3.0))
    return Panel(
        f"{SHORT_NAMES.get(o.channel, o.channel)}, times noise",
        o.w,
        tuple(lines),
        limits=limits,
        levels=(1.0,),
        height=110,
    )
