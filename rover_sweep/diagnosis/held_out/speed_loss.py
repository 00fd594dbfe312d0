"""Speed that cornering takes beyond what turned wheels take anyway, seen in the measured speed itself.

    V' = (V_set - V)/tau - Ff sin(d)/m + v r - D a_y^2

The first three terms belong to every rover (Ff sin(d), v r: the front force pulls back, out of the fitted
model); D is the finding. The noise of a measured speed is slow, so rows are whitened by an
autoregression of what the fit leaves, and the threshold comes from noise of that kind.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.effects import library
from rover_sweep.diagnosis.simulation.experiment import RATE, Experiment, smoothed
from rover_sweep.diagnosis.simulation.simulator import Structure, Values, motion

EVERY = 40  # samples of the simulation that one row stands for; the measured speed is smoothed over 50
LAGS = np.geomspace(0.2, 5.0, 13)  # s, of the drive: speed controller, motor and mass
ORDER = 3  # of the autoregression
UNSURE = 0.1  # standard deviation of the rover's own drag, relative: toe and scrub of the wheels
DRAWS = 2000
FALSE_ALARMS = 0.003  # one effect among two dozen
EDGE = 1.0  # s, left out at both ends


Rows = tuple[Array, Array, Array, Array]


@dataclass(frozen=True)
class SpeedLoss:
    """D [s^2/m] with its 90 % interval; lag [s] of the drive; gain against the threshold.

    drop: share of the speed that it took where it took most. noise: variance of the speed [m^2/s^2] that
    the loss leaves.
    """

    loss: float
    low: float
    high: float
    lag: float
    gain: float
    threshold: float
    drop: float
    noise: float

    @property
    def found(self) -> bool:
        """True where it is beyond chance and its material size."""
        effect = library()["speed_variation"]
        return self.gain > self.threshold and effect.exceeds({effect.key("D"): self.loss}, effect.thresholds)


@dataclass(frozen=True, eq=False)
class Drive:
    """One run's speed and what drives it, (n,): measured, own drag and a_y^2 [m/s^2, m^2/s^4]; t [s]."""

    t: Array
    speed: Array
    own: Array
    square: Array


def speed_loss(runs: Sequence[Experiment], structure: Structure, x: Values, seed: int) -> SpeedLoss:
    """What cornering took of the speed of these runs, by a fitted model of their motion."""
    drives = [_drive(run, structure, x) for run in runs]
    table = [[_rows(drive, float(lag)) for drive in drives] for lag in LAGS]
    white = np.zeros(ORDER)
    for _ in range(3):
        fits = [_regressed(rows, white) for rows in table]
        best = min(range(LAGS.size), key=lambda k: fits[k][0])
        white = _autoregression(_left(table[best], fits[best][1]))
    fits = [_regressed(rows, white) for rows in table]
    return _judged(drives, table, fits, seed)


def speed_predicted(run: Experiment, structure: Structure, x: Values, loss: float, lag: float) -> Array:
    """Speed (n,) m/s of a run by the rover's own drag and a loss D, about the run's mean."""
    drive = _drive(run, structure, x)
    taken = _through(drive.own - loss * drive.square, lag)
    return float(np.mean(run.speed)) + taken - float(np.mean(taken))


def _drive(run: Experiment, structure: Structure, x: Values) -> Drive:
    moved, rover = motion(run, structure, x), structure.rover
    inertia = np.exp(x["ln_Izz"]) if "ln_Izz" in x else rover.yaw_inertia or rover.mass * rover.a * rover.b
    front = (rover.b * moved["across"] + inertia / rover.mass * moved["r_dot"]) / rover.wheelbase
    return Drive(
        run.t, run.speed, moved["v"] * moved["r"] - front * np.sin(moved["delta"]), moved["across"] ** 2
    )


def _through(u: Array, lag: float) -> Array:
    """Speed (n,) m/s, as a run keeps it, that an acceleration u (n,) leaves where a drive brings it back."""
    return smoothed(np.asarray(lfilter([1.0 / RATE], [1.0, -np.exp(-1.0 / (RATE * lag))], u)))


def _rows(drive: Drive, lag: float) -> Rows:
    """(speed less own drag, loss per D, own drag, nuisances (k, 2)) at the rows."""
    inside = slice(int(EDGE * RATE), -int(EDGE * RATE), EVERY)
    own, square = _through(drive.own, lag)[inside], _through(drive.square, lag)[inside]
    beginning = np.exp(-drive.t[inside] / lag)
    return drive.speed[inside] - own, -square, own, np.column_stack((np.ones(own.size), beginning))


def _whitened(rows: Array, white: Array) -> Array:
    return np.asarray(lfilter(np.concatenate(([1.0], -white)), [1.0], rows, axis=0))[ORDER:]


def _regressed(runs: Sequence[Rows], white: Array) -> tuple[float, float, Array, Array, Array]:
    """(cost, D, rows of the speed, of one D, of the own drag), whitened, the nuisances taken out."""
    parts = []
    for y, z, own, nuisance in runs:
        q = np.linalg.qr(_whitened(nuisance, white))[0]
        rows = _whitened(np.column_stack((y, z, own)), white)
        parts.append(rows - q @ (q.T @ rows))
    y, z, own = np.concatenate(parts).T
    power = float(z @ z)
    loss = max(float(y @ z) / power, 0.0) if power > 1e-12 else 0.0
    return float(np.sum((y - loss * z) ** 2)), loss, y, z, own


def _left(runs: Sequence[Rows], loss: float) -> list[Array]:
    out = []
    for y, z, _, nuisance in runs:
        left = y - loss * z
        out.append(left - nuisance @ np.linalg.lstsq(nuisance, left, rcond=None)[0])
    return out


def _autoregression(left: Sequence[Array]) -> Array:
    """Coefficients (ORDER,) of the autoregression that leaves the least of what is left."""
    past = np.concatenate([np.column_stack([y[ORDER - k : -k] for k in range(1, ORDER + 1)]) for y in left])
    now = np.concatenate([y[ORDER:] for y in left])
    return np.asarray(np.linalg.lstsq(past, now, rcond=None)[0])


def _judged(
    drives: Sequence[Drive],
    table: Sequence[Sequence[Rows]],
    fits: Sequence[tuple[float, float, Array, Array, Array]],
    seed: int,
) -> SpeedLoss:
    costs = np.array([f[0] for f in fits])
    best = int(np.argmin(costs))
    rows = fits[best][2].size
    noise = costs[best] / max(rows - 2 * len(drives) - 2, 1)
    none = min(float(y @ y) for _, _, y, _, _ in fits)
    random = np.random.default_rng(seed)
    units = np.column_stack([z / (np.linalg.norm(z) or 1.0) for _, _, _, z, _ in fits])
    own = fits[best][4]
    chance = random.standard_normal((DRAWS, rows)) * np.sqrt(noise)
    chance += UNSURE * random.standard_normal((DRAWS, 1)) * own
    gains = np.max(np.maximum(chance @ units, 0.0), axis=1) ** 2 / noise
    # every drive that the costs do not exclude, with the losses that it leaves possible
    weights = np.exp(-0.5 * (costs - costs[best]) / noise)
    picked = random.choice(len(fits), DRAWS, p=weights / weights.sum())
    sizes = np.array([np.sqrt(f[3] @ f[3]) for f in fits])
    pull = np.array([f[4] @ f[3] / (f[3] @ f[3]) for f in fits])
    centre = np.array([f[1] for f in fits])
    drawn = centre[picked] + random.standard_normal(DRAWS) * np.sqrt(noise) / sizes[picked]
    drawn += UNSURE * random.standard_normal(DRAWS) * pull[picked]
    low, high = np.percentile(np.maximum(drawn, 0.0), (5.0, 95.0))
    lag, loss = float(LAGS[best]), fits[best][1]
    drop = max(loss * float(np.max(_through(d.square, lag))) / float(np.mean(d.speed)) for d in drives)
    left = np.concatenate(_left(table[best], loss))
    return SpeedLoss(
        loss,
        float(low),
        float(high),
        lag,
        float(none - costs[best]) / noise,
        float(np.quantile(gains, 1.0 - FALSE_ALARMS)),
        drop,
        float(np.var(left)),
    )
