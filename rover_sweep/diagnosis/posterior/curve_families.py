"""Candidate laws: each place with each quantity that it may depend on, as a group of hat functions.

A group is a curve with free points: linear between `KNOTS` points over the range that the runs visited.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.posterior.transfers import RunTransfers, tapered_spectrum
from rover_sweep.diagnosis.simulation.table_law import TableLaw, acting, quantity, remembered

KNOTS = 7
LEAST = 1e-9  # range of a quantity below which it does not vary
LAGS = (0.03, 0.1, 0.3)  # s
PLAYS = (0.1, 0.25)  # of the largest steering angle
_BODY = ("delta", "delta_dot", "a_y", "r", "p", "phi", "beta", "v", "psi", "t")
_SCALED = (("t", "delta"), ("v", "delta"), ("t", "a_y"), ("v", "a_y"), ("psi", "v^2"))
_OVER: dict[str, tuple[str, ...]] = {
    "steering": ("delta", "delta_dot"),
    "side force front": _BODY,
    "side force rear": _BODY,
    "side force": _BODY,
    "yaw moment": _BODY,
    "roll moment": ("phi", "p", "a_y", "delta", "r", "v", "psi", "t"),
    "sensor of r": ("signal", "signal_dot", "p", "a_y", "v", "t", "psi", "phi"),
    "sensor of ay": ("signal", "signal_dot", "r", "p", "r_dot", "p_dot", "v_dot", "v", "t", "psi"),
    "sensor of p": ("signal", "signal_dot", "r", "a_y", "r_dot", "v", "t", "psi"),
    "sensor of vy": ("signal", "signal_dot", "r", "a_y", "phi", "v", "t", "psi"),
}
_FACTORED: dict[str, tuple[tuple[str, str], ...]] = {
    "side force front": _SCALED,
    "side force rear": (*_SCALED[2:], ("t", "r")),
    "side force": (("psi", "v^2"), ("v", "a_y"), ("t", "a_y")),
    "yaw moment": (("t", "r"), ("v", "r"), ("psi", "v^2")),
}
_REMEMBERING = {
    "steering": "delta",
    "side force rear": "a_y",
    "yaw moment": "r",
    "roll moment": "p",
    "sensor of r": "signal",
    "sensor of ay": "signal",
    "sensor of p": "signal",
    "sensor of vy": "signal",
}


def groups(found: Sequence[RunTransfers]) -> Iterator[TableLaw]:
    """The candidates that can act in these runs, with their points and y = 0."""
    for place in found[0].responses:
        for over in _OVER[place]:
            yield from _over_range(TableLaw(place, over, (), ()), found)
        for over, times in _FACTORED.get(place, ()):
            yield from _over_range(TableLaw(place, over, (), (), times), found)
        over = _REMEMBERING.get(place, "")
        for lag in LAGS if over else ():
            yield from _over_range(TableLaw(place, over, (), (), memory="lag", size=lag), found)
        if place == "steering":
            most = max(float(np.max(np.abs(t.motion["delta"]))) for t in found)
            for share in PLAYS:
                yield from _over_range(TableLaw(place, over, (), (), memory="play", size=share * most), found)


def _over_range(law: TableLaw, found: Sequence[RunTransfers]) -> Iterator[TableLaw]:
    """The law with points over the range of its quantity; none where the quantity does not vary."""
    x = np.concatenate([abscissa(law, t) for t in found])
    low, high = (-np.pi, np.pi) if law.over == "psi" else (float(np.min(x)), float(np.max(x)))
    if high - low > LEAST and np.ptp(np.quantile(x, (0.05, 0.95))) > LEAST:
        points = np.linspace(low, high, KNOTS)
        yield replace(law, x=tuple(points.tolist()), y=(0.0,) * KNOTS)


def abscissa(law: TableLaw, t: RunTransfers) -> Array:
    """The quantity (n,) that the law depends on in one run, with its memory."""
    return remembered(quantity(law.over, t.motion, signal_of(law, t)), law.memory, law.size)


def signal_of(law: TableLaw, t: RunTransfers) -> Array | None:
    """The signal (n,) of the sensor at which the law acts, None elsewhere."""
    return t.signals[law.place.split()[-1]] if law.place.startswith("sensor of ") else None


def unit_spectra(law: TableLaw, found: Sequence[RunTransfers]) -> list[list[Any]]:
    """For each coefficient of the law the spectra, one for each run, of what 1 of it adds."""
    out = []
    for k in range(len(law.x)):
        one = replace(law, y=tuple(float(j == k) for j in range(len(law.x))))
        out.append([tapered_spectrum(t.run, acting(one, t.motion, signal_of(law, t))) for t in found])
    return out
