"""A picture drawn by matplotlib, and the same data as an interactive chart."""

from __future__ import annotations

import io
import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from typing import Any, Protocol

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullLocator

from rover_sweep.data.recording import Array
from rover_sweep.files.documents import printable
from rover_sweep.files.replaced import end_with_parent
from rover_sweep.report.charts.chart import Chart
from rover_sweep.report.charts.static_svg import ShownChart, chart_json, png_source

# Style of the report's pictures: colour-blind safe colours, line styles, units, axes.


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


# Pictures drawn on all processors: matplotlib holds Python's lock, so each process draws some.


MOST = 4  # processes


class Drawable(Protocol):
    """A picture that can be drawn as PNG."""

    def png(self) -> bytes:
        """The figure as PNG bytes."""


_given: Sequence[Drawable] = ()  # what a forked process inherits: figures' functions cannot be sent to it


def pngs(pictures: Sequence[Drawable]) -> Iterator[bytes]:
    """The PNG of each picture, in their order, as soon as it is drawn; the bytes are those of one process.

    Elsewhere than on Linux and in the main thread, where a fork is safe, one after the other.
    """
    global _given
    processes = min(os.cpu_count() or 1, len(pictures), MOST)
    forks = sys.platform == "linux" and threading.current_thread() is threading.main_thread()
    if processes < 2 or not forks:
        yield from (picture.png() for picture in pictures)
        return
    _given = pictures
    try:
        with ProcessPoolExecutor(processes, multiprocessing.get_context("fork"), _begin) as pool:
            waiting = [pool.submit(_png, k) for k in range(len(pictures))]
            for k, one in enumerate(waiting):
                try:
                    yield one.result()
                except BrokenProcessPool:  # the system ended a process, for want of memory for one
                    yield pictures[k].png()
                except KeyboardInterrupt:
                    pool.shutdown(wait=False, cancel_futures=True)
                    raise
    finally:
        _given = ()


def _begin() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches every process; the parent answers it
    end_with_parent()


def _png(k: int) -> bytes:
    return _given[k].png()


@dataclass(frozen=True, eq=False)
class Picture:
    """A matplotlib picture of a report. name: of its file, without .png; section: of its page; make: its
    figure; chart: the same data for the interactive page, None for a picture that is only static."""

    name: str
    section: str
    caption: str
    make: Callable[[], Figure]
    chart: Callable[[], Chart] | None = None

    def figure(self) -> Figure:
        """The figure, in the report's style."""
        with styled():
            return self.make()

    def png(self) -> bytes:
        """The figure as PNG bytes."""
        with styled():
            return png(self.make())


# Pictures drawn by matplotlib, with the data of the interactive charts where they have some.


def drawn_pictures(
    plan: Sequence[Picture], progress: Callable[[float, str], None] | None = None
) -> tuple[ShownChart, ...]:
    """All pictures, drawn on all processors. progress: called with the share done, 0..1, and the step."""
    shown = []
    made = pngs(plan)
    for k, picture in enumerate(plan):
        if progress:
            progress(k / len(plan), f"drawing {picture.name}")
        data = chart_json(picture.chart()) if picture.chart else ""
        shown.append(ShownChart(picture.section, picture.caption, source=png_source(next(made)), data=data))
    return tuple(shown)
