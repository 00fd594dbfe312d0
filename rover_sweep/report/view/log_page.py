"""The page of a log: all channels as data, and two selects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from markupsafe import Markup

from rover_sweep.data.recording import Signal
from rover_sweep.report.charts.chart import kept_points
from rover_sweep.report.charts.static_svg import in_script, packed
from rover_sweep.report.in_html import templates
from rover_sweep.report.wording import versions

MOST = 200_000  # points of a page: about 2 MB


def log_page(name: str, logs: Sequence[Mapping[str, Signal]]) -> str:
    """HTML of the logs in one file. Long channels are thinned such that every peak stays."""
    signals = {
        (channel if len(logs) == 1 else f"{channel} ({k + 1})"): signal
        for k, log in enumerate(logs)
        for channel, signal in log.items()
        if signal.t.size > 1
    }
    start = min((float(s.t[0]) for s in signals.values()), default=0.0)
    most = MOST // max(len(signals), 1)
    data = {label: _channel(signal, start, most) for label, signal in signals.items()}
    page = templates().get_template("view/view.html.j2")
    return page.render(name=name, channels=data, data=Markup(in_script(data)), versions=versions())


def _channel(signal: Signal, start: float, most: int) -> dict[str, object]:
    kept = kept_points([signal.x], most)
    factor, unit = (
        (180 / np.pi, signal.unit.replace("rad", "deg")) if "rad" in signal.unit else (1.0, signal.unit)
    )
    return {
        "unit": unit.replace("^2", "²"),
        "source": signal.source,
        "hold": signal.hold,
        "t": packed(signal.t[kept] - start),
        "x": packed(signal.x[kept] * factor),
    }
