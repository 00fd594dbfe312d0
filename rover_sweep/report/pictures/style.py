"""Style of the report's pictures: colour-blind safe colours, line styles, units, axes."""

from __future__ import annotations

import io
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullLocator

from rover_sweep.data.recording import Array
from rover_sweep.files.printable import printable

DPI = 115
WIDTH = 10.5  # in
DATA = "#222222"
# Okabe and Ito's palette; the line styles separate the models without colour.
MODEL_LINES: Mapping[str, Mapping[str, Any]] = {
    "kinematic": {"color": "#CC79A7", "linestyle": (0, (1, 1.2)), "linewidth": 2.2},
    "bicycle": {"color": "#0072B2", "linestyle": (0, (6, 2))},
    "roll-yaw": {"color": "#D55E00", "linestyle": "-"},
    "lumped": {"color": "#009E73", "linestyle": (0, (5, 1.5, 1.2, 1.5))},
}
OWN_COLOURS = ("#56B4E9", "#8C510A", "#777777")  # for a user's own structures, in turn
BAND = "#E69F00"
OUTSIDE = "#ECECEC"
QUIET = "#56B4E9"

LABELS = {
    "r": "yaw rate r",
    "ay": "lateral acceleration $a_y$",
    "p": "roll rate p",
    "vydot": r"lateral velocity rate $\dot V_y$",
}

RC: dict[Any, Any] = {
    "font.size": 10,
    "axes.titlesize": 10.5,
    "axes.titlelocation": "left",
    "axes.labelsize": 10,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#D8D8D8",
    "grid.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.frameon": False,
    "legend.fontsize": 9.5,
    "lines.linewidth": 1.3,
    "figure.facecolor": "white",
    "path.simplify_threshold": 0.5,
}


def model_line(name: str, names: Collection[str]) -> Mapping[str, Any]:
    """Line style of a model; a user's own structure gets one by its position in `names`."""
    if name in MODEL_LINES:
        return MODEL_LINES[name]
    place = [n for n in names if n not in MODEL_LINES].index(name)
    return {"color": OWN_COLOURS[place % len(OWN_COLOURS)], "linestyle": (0, (3, 1, 1, 1, 1, 1))}


def literal(name: str) -> str:
    """A name as literal text in a picture: `$` starts no formula, control characters are visible."""
    return printable(name).replace("$", r"\$")


def png(figure: Figure) -> bytes:
    """The figure as PNG; the same figure gives the same bytes."""
    out = io.BytesIO()
    figure.savefig(out, format="png", dpi=DPI, metadata={"Software": None})
    return out.getvalue()


def styled() -> Any:
    """Context with the report's style, for making and drawing figures."""
    return matplotlib.rc_context(RC)


def log_frequency(axes: Axes, low: float, high: float, labelled: bool) -> None:
    """A logarithmic frequency axis low..high [rad/s] with plain numbers at 1, 2 and 5 of each decade."""
    axes.set_xscale("log")
    axes.set_xlim(low, high)
    ticks = [m * 10.0**e for e in range(-3, 4) for m in (1, 2, 5)]
    axes.set_xticks([t for t in ticks if low <= t <= high])
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    if labelled:
        axes.set_xlabel("frequency, rad/s")
    else:
        axes.tick_params(labelbottom=False)


def limits(values: Sequence[Array], least: float) -> tuple[float, float]:
    """Axis limits around all finite values, with a margin, at least `least` apart."""
    x = np.concatenate([v[np.isfinite(v)] for v in values])
    low, high = (float(x.min()), float(x.max())) if x.size else (0.0, 0.0)
    spare = max(0.08 * (high - low), (least - (high - low)) / 2)
    return low - spare, high + spare
