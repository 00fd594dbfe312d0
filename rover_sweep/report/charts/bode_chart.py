"""Responses of recording and simulation, before and after, over each other."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from rover_sweep.comparison.answer import Bode
from rover_sweep.report.charts.chart import Chart, Curve, Panel, Stack
from rover_sweep.report.charts.colours import AFTER, BEFORE, DATA, MARK, OUTSIDE, RESPONSE_WORDS
from rover_sweep.report.charts.response_charts import limits_around
from rover_sweep.spectra.exponentials import Complex


def bode_chart(responses: Sequence[Bode]) -> Chart:
    """Magnitude, phase and coherence of each response; outside of the coherent band shaded."""
    return Chart(tuple(_stack(b) for b in responses), columns=2)


def _stack(b: Bode) -> Stack:
    low, high = b.band or (float(b.w[0]), float(b.w[-1]))
    inside = (b.w >= low * 0.999) & (b.w <= high * 1.001)
    styles: dict[str, tuple[Complex, dict[str, Any]]] = {
        "recorded": (b.recorded, {"colour": DATA, "width": 2.0}),
        "before": (b.before, BEFORE),
        "after": (b.after, AFTER),
    }
    db = {n: 20 * np.log10(np.maximum(np.abs(h), 1e-9)) for n, (h, _) in styles.items()}
    deg = {n: np.degrees(np.unwrap(np.angle(h))) for n, (h, _) in styles.items()}
    deg = {n: y - 360.0 * np.round(float(y[inside][0]) / 360.0) for n, y in deg.items()}
    panels = [
        Panel(
            words,
            b.w,
            tuple(Curve(n, y, **styles[n][1]) for n, y in values.items()),
            limits=limits_around([y[inside] for y in values.values()], least),
            height=height,
        )
        for words, values, least, height in (("magnitude, dB", db, 20, 150), ("phase, deg", deg, 100, 130))
    ]
    panels.append(
        Panel("coherence", b.w, (Curve("coherence", b.coherence, DATA),), limits=(0.0, 1.04), height=70)
    )
    shades = ((1e-3, low, OUTSIDE), (high, 1e4, OUTSIDE)) if b.band else ()
    marks = ((low, MARK), (high, MARK)) if b.band else ()
    title = f"{RESPONSE_WORDS.get(b.output, b.output)} / steering"
    span = 0.93 * float(b.w[0]), 1.07 * float(b.w[-1])
    return Stack(title, "frequency, rad/s", tuple(panels), span, "log", shades, marks)
