"""`ModelResult.plot` and `Verification.plot`: a run that was not fitted, measured and predicted."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from rover_sweep.drawing.axes import panels
from rover_sweep.errors import UsageError
from rover_sweep.identification.model_results import ModelResult
from rover_sweep.identification.verify import Verification
from rover_sweep.report.pictures.style import DATA, LABELS, MODEL_LINES, WIDTH
from rover_sweep.report.pictures.verification import draw_predicted

ROW = 1.9  # in
DEG = {"r": (180 / np.pi, "deg/s"), "p": (180 / np.pi, "deg/s")}
UNITS = {"ay": "m/s²", "vy": "m/s", "vydot": "m/s²"}


def draw_model(model: ModelResult, axes: Any) -> Any:
    """Axes (channels,) of the first verification run. UsageError for a model without one."""
    if not model.verification:
        raise UsageError(
            f"the {model.fit.structure.name} model was verified on no run, so there is nothing to draw; give "
            "rs.identify(runs, verify=...) a doublet, or use result.plot() for the responses"
        )
    return draw_verification(model.verification[0], model.fit.structure.name, axes)


def draw_verification(found: Verification, model: str, axes: Any) -> Any:
    """Axes (channels,) of measured and predicted channels over time [s]."""
    names = [o.channel for o in found.overlays]
    with panels(axes, (len(names), 1), names, (WIDTH, 0.7 + ROW * len(names)), sharex=True) as given:
        for one, channel in zip(given[:, 0], names, strict=True):
            draw_predicted(one, channel, {model: found}, float(found.overlays[0].t[0]))
        given[0, 0].set_title(f"{found.run} at {found.speed:.2f} m/s")
        given[0, 0].legend()
        given[-1, 0].set_xlabel("time since start of the manoeuvre, s")
    return given[:, 0]


def draw_simulation(
    title: str, t: Any, signals: Any, measured: Any, channels: Sequence[str] | None, axes: Any
) -> Any:
    """Axes (channels,) of simulated and measured channels over time. signals, measured: {channel: (n,)}."""
    wanted = [channels] if isinstance(channels, str) else list(channels or _both(signals, measured))
    if unknown := [c for c in wanted if c not in signals]:
        raise UsageError(f"the model has no channel {unknown[0]!r}; it has {', '.join(signals)}")
    with panels(axes, (len(wanted), 1), wanted, (WIDTH, 0.7 + ROW * len(wanted)), sharex=True) as found:
        for one, channel in zip(found[:, 0], wanted, strict=True):
            factor, unit = DEG.get(channel, (1.0, UNITS.get(channel, "")))
            if channel in measured:
                one.plot(t - t[0], factor * measured[channel], color=DATA, linewidth=0.9, label="measured")
            one.plot(t - t[0], factor * signals[channel], label="simulated", **MODEL_LINES["roll-yaw"])
            one.set_ylabel(f"{LABELS.get(channel, channel)}\n{unit}")
        found[0, 0].set_title(title)
        found[0, 0].legend()
        found[-1, 0].set_xlabel("time, s")
    return found[:, 0]


def _both(signals: Any, measured: Any) -> list[str]:
    return [c for c in signals if c in measured] or list(signals)
