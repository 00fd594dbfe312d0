"""The axes to draw on: the user's, or those of a new figure in the style of the reports."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from rover_sweep.errors import UsageError
from rover_sweep.report.pictures.style import styled


@contextmanager
def panels(
    given: Any, shape: tuple[int, int], names: Sequence[str], size: tuple[float, float], **grid: Any
) -> Iterator[Any]:
    """Axes (rows, columns): those given (one, or a sequence or array of as many), or new ones.

    names: of the panels, for the error; size: of a new figure [in]; grid: further arguments of
    `Figure.subplots`. UsageError for another number of axes.
    """
    if given is not None:
        yield _checked(given, shape, names)
        return
    from matplotlib import pyplot

    # outside the style: the first figure starts a notebook's backend, whose settings the style would undo
    figure = pyplot.figure(figsize=size, layout="constrained", facecolor="white")
    with styled():
        yield figure.subplots(*shape, squeeze=False, **grid)


def _checked(given: Any, shape: tuple[int, int], names: Sequence[str]) -> Any:
    flat = (
        np.array([given], dtype=object) if isinstance(given, Axes) else np.array(given, dtype=object).ravel()
    )
    wrong = [type(one).__name__ for one in flat if not isinstance(one, Axes)]
    if wrong:
        raise UsageError(f"axes holds a {wrong[0]}; give matplotlib axes, one for each of {', '.join(names)}")
    if flat.size != shape[0] * shape[1]:
        raise UsageError(f"{flat.size} axes were given, but {len(names)} are needed: {', '.join(names)}")
    return flat.reshape(shape)
