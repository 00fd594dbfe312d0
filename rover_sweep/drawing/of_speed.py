"""`SpeedIdentification.plot`: throttle and speed over time, with the speed that the law simulates."""

from __future__ import annotations

from typing import Any

from rover_sweep.drawing.axes import panels
from rover_sweep.identification.speed.identify_speed import SpeedResult
from rover_sweep.identification.speed.speed_fit import fitted_speed, grid_of
from rover_sweep.report.pictures.style import DATA, MODEL_LINES, literal


def draw_speed(result: SpeedResult, axes: Any) -> Any:
    """Axes (2, runs) of throttle [%] and speed [m/s]."""
    names = [f"{row} of {run.name}" for row in ("throttle", "speed") for run in result.runs]
    size = max(6.0, 5.5 * len(result.runs)), 4.6
    with panels(axes, (2, len(result.runs)), names, size, sharex="col") as found:
        for k, run in enumerate(result.runs):
            t = grid_of(run)
            found[0, k].plot(t - t[0], 100 * run.drive(t), color=DATA, linewidth=0.9)
            found[1, k].plot(t - t[0], run.speed.on(t), color=DATA, linewidth=0.9, label="measured")
            if result.fit is not None:
                _, law = fitted_speed(result.fit, run, result.fit.starts[k])
                found[1, k].plot(t - t[0], law, label="simulated by the law", **MODEL_LINES["roll-yaw"])
            found[0, k].set_title(literal(run.name))
            found[1, k].set_xlabel("time since the sweep began, s")
        found[0, 0].set_ylabel("throttle, %")
        found[1, 0].set_ylabel("speed, m/s")
        found[1, 0].legend()
    return found
