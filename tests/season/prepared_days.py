"""Measured logs with prepared likelihoods: what a fit of a log would say, without driving or fitting."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from datetime import date, timedelta

import numpy as np

from rover_sweep.comparison.common_model import of_the_rover
from rover_sweep.data.geometry import Geometry
from rover_sweep.season.season_result import FittedLog, MeasuredLog, season_model

ROVER = Geometry(2.66, 0.203, 0.188, 2.4, 0.058, 0.0125, 0.071)
BEGIN = date(2026, 3, 1)
SCATTER = 0.08  # of a coordinate's scale
Course = Callable[[int], Mapping[str, float]]  # {coordinate: what it differs by, SI units} on a day


def day_name(k: int) -> str:
    """ISO date of session k, two weeks apart."""
    return (BEGIN + timedelta(days=14 * k)).isoformat()


def vehicle_logs(
    name: str,
    days: int,
    seed: int,
    course: Course = lambda k: {},
    parameters: Callable[[int], Mapping[str, float]] = lambda k: {},
    board: Callable[[int], str] = lambda k: "",
) -> list[MeasuredLog]:
    """One log of each day. Some combinations of coordinates are known well, others hardly."""
    random = np.random.default_rng(seed)
    free = of_the_rover(season_model(ROVER).free)
    scale = np.array([c.scale for c in free])
    usual = np.array([c.start for c in free]) / scale + 0.3 * random.standard_normal(scale.size)
    out = []
    for k in range(days):
        moved = np.array([course(k).get(c.name, 0.0) for c in free]) / scale
        true = usual + moved + SCATTER * random.standard_normal(scale.size)
        rows = (
            random.standard_normal((2 * scale.size, scale.size))
            * np.geomspace(3.0, 0.3, 2 * scale.size)[:, None]
        )
        measured = rows @ true + random.standard_normal(len(rows))
        fit = FittedLog(tuple(c.name for c in free), true, rows.T @ rows, rows.T @ measured, 1.0, ("run1",))
        place = (f"logs/{name}/{k}.BIN", f"{name}-{k}", day_name(k), "GPS", board(k))
        known = {"vehicle": name, "vehicle_file": "rover", "parameters": parameters(k)}
        out.append(MeasuredLog(*place, fit=fit, **known))
    return out
