"""Steering and speed of a recorded drive at every main loop: the input of every redrive."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class AppletState:
    """The applet's rows of the recorded drive: t (n,) s, run, state, clock (n,), out (n,) us."""

    t: Array
    run: Array
    state: Array
    clock: Array
    out: Array


@dataclass(frozen=True, eq=False)
class Course:
    """t (n,) s: main loops of the recorded drive, increasing; steering (n,) us on the servo and speed (n,)
    m/s from each loop on; heading [rad] at the first, left positive from north.
    asked_t (k,) s, asked (k,) us: the steering staircase as it was set, before it waited for a main loop.

    applet: its rows, None where none was logged. marks: (t [s], text) of messages to the user. parameters:
    those of the vehicle, by name.
    """

    t: Array
    steering: Array
    speed: Array
    asked_t: Array
    asked: Array
    heading: float = 0.0
    applet: AppletState | None = None
    marks: tuple[tuple[float, str], ...] = ()
    parameters: Mapping[str, float] = field(default_factory=dict)

    @property
    def loop_s(self) -> float:
        """Median period of the main loop, s."""
        return float(np.median(np.diff(self.t)))
