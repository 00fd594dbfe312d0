"""Models with the steering of a verification run as input."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rover_sweep.data.recording import Array, Recording
from rover_sweep.identification.verify import Verification
from rover_sweep.report.charts.chart import Chart, Curve, Panel, Stack
from rover_sweep.report.charts.colours import CHANNEL_WORDS, DATA, model_colours
from rover_sweep.report.wording.shown_units import FOOT, SI, ShownUnits


def verification_chart(
    run: Recording | None, verdicts: Mapping[str, Verification], units: ShownUnits = SI
) -> Chart:
    """Steering of `run` (if given), and each channel measured and predicted by every model."""
    channels = [
        c for c in ("r", "ay", "p") if any(o.channel == c for v in verdicts.values() for o in v.overlays)
    ]
    first = next(iter(verdicts.values()))
    start = run.span[0] if run is not None else float(first.overlays[0].t[0])
    panels = [_channel(c, verdicts, start, units) for c in channels]
    if run is not None and "delta" in run:
        delta = run.manoeuvre("delta")
        line = Curve("steering", np.degrees(delta.x), DATA, width=1.0, step=delta.hold)
        panels.insert(0, Panel("steering, deg", delta.t - start, (line,), height=84))
    end = max(float(p.x[-1]) for p in panels)
    grade = ", ".join(f"{n}: J_rms {v.j_rms:.2f}, TIC {v.tic:.3f}" for n, v in verdicts.items())
    title = f"{first.run}; {grade}"
    return Chart((Stack(title, "time since start of the manoeuvre, s", tuple(panels), (0.0, end)),))


def _channel(channel: str, verdicts: Mapping[str, Verification], start: float, units: ShownUnits) -> Panel:
    found = {n: o for n, v in verdicts.items() for o in v.overlays if o.channel == channel}
    first = next(iter(found.values()))
    factor = FOOT * units.per_si if first.unit.startswith("ft") else 1.0
    lines = [Curve("measured", first.measured * factor, DATA, width=1.0)]
    lines += [
        Curve(n, _at(o.t, o.model, first.t) * factor, **model_colours(n, verdicts)) for n, o in found.items()
    ]
    return Panel(units.words(CHANNEL_WORDS[channel]), first.t - start, tuple(lines), height=140)


def _at(t: Array, y: Array, grid: Array) -> Array:
    """The values on the grid of the first model; the same one unless their runs differ."""
    return y if t.size == grid.size else np.interp(grid, t, y)
