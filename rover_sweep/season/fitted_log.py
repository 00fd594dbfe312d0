"""The runs of one log fitted with the model of a season, as a likelihood of the model's coordinates.

A day determines some combinations of coordinates well and others hardly: lag, inertia and steering scale, for
one, replace each other in a short run. The estimates of single days therefore scatter together. The quadratic
likelihood of the day at its fit, without the priors,

    log L(x) = -1/2 x^T D x + h^T x,   D = J^T J/v,   h = D x_fit + J^T r/v

keeps all of it, so that the days of a vehicle can share every coordinate that did not change. J: Jacobian of
the rows by the coordinates over their scales, r: residual rows, v: their variance. The priors count once for
a vehicle, not once a day.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits

from rover_sweep.comparison.common_model import side_of
from rover_sweep.data.geometry import Geometry
from rover_sweep.data.recording import Array, Recording
from rover_sweep.data.tolerances import Tolerances
from rover_sweep.diagnosis.simulation.candidates import Model
from rover_sweep.diagnosis.simulation.experiment import experiment, in_order
from rover_sweep.spectra.side_by_side import one_thread

EFFECTS = ("steering_backlash",)
SEASON = Tolerances(
    lag=0.25,
    delay=0.25,
    early=0.03,
    ratio=1.0,
    bias_ay=1.5,
    trim=0.06,
    scale=0.03,
    speed=0.01,
    cg=0.025,
    h=0.10,
    roll_inertia=0.15,
    imu_x=0.05,
    imu_z=0.05,
    sensor_lag=0.006,
    velocity_gain=0.10,
    velocity_lag=0.30,
    heading=0.03,
    together=0.20,
    bend=1.5,
)
"""Wide where a rover changes, near the vehicle file elsewhere, so that the fits of all days are close."""


@dataclass(frozen=True, eq=False)
class FittedLog:
    """The likelihood of the k coordinates over their scales, see the module.

    names: of the coordinates. values (k,): the fit, with the priors. information (k, k): D. linear (k,): h.
    variance: of a whitened row, 1 at the noise floor. runs: names of the fitted runs.
    """

    names: tuple[str, ...]
    values: Array
    information: Array
    linear: Array
    variance: float
    runs: tuple[str, ...]


def season_model(rover: Geometry) -> Model:
    """The model of a season: the roll-yaw model with play, the bicycle where the file has no roll."""
    rolls = bool(rover.sprung_mass and rover.h and rover.roll_inertia)
    return Model("roll-yaw" if rolls else "bicycle", rover, SEASON, EFFECTS)


@threadpool_limits.wrap(limits=1, user_api="blas")
def fitted_log(runs: Sequence[Recording], rover: Geometry) -> FittedLog:
    """The runs, with `delta`, fitted together, on one thread. rover: of the vehicle file."""
    with one_thread():
        side = side_of(in_order([experiment(run) for run in runs]), season_model(rover), {}, EFFECTS)
    fitted, variance = side.fitted, side.fitted.overdispersion
    information = fitted.jacobian.T @ fitted.jacobian / variance
    linear = information @ side.values + fitted.jacobian.T @ fitted.rows / variance
    names = tuple(c.name for c in side.coordinates)
    return FittedLog(
        names, side.values, np.asarray(information), linear, variance, tuple(r.name for r in runs)
    )
