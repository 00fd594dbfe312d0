"""Speed lost in corners, beyond the drag of the turned wheels, from the measured speed.

    V' = (V_set - V)/tau - Ff sin(d)/m + v r - D a_y^2

Every rover has the first three terms; Ff sin(d) and v r come from the fitted model. D is the finding.

For each lag tau of a grid, the speed minus its own drag is regressed on the response to a_y^2. A constant,
the decay of the initial speed, and gravity along the heading on sloping ground are nuisances; own drag has
the error `UNSURE`. The noise of a measured speed is slow, so the rows are whitened by an autoregression of
the residual, estimated three times in turn with D (Cochrane and Orcutt 1949). The probability that turns cost
speed has the weight of one effect against none, as in `posterior.weights`.

The finding is kept where held-out runs, driven at the speed that it predicts, confirm it.

Cochrane and Orcutt 1949: Application of least squares regression to relationships containing
auto-correlated error terms, J. American Statistical Association 44(245).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.data.results import ByName, Quantity
from rover_sweep.diagnosis.effects import library
from rover_sweep.diagnosis.effects.effect import Values
from rover_sweep.diagnosis.held_out import HeldOutRun, fit_of
from rover_sweep.diagnosis.posterior.infer import SURE
from rover_sweep.diagnosis.posterior.weights import FIRST, SPAN, WIDTH
from rover_sweep.diagnosis.problem.least_squares import COARSE
from rover_sweep.diagnosis.result import Finding, HeldOut, Unknown
from rover_sweep.diagnosis.simulation.candidates import Model
from rover_sweep.diagnosis.simulation.experiment import RATE, Experiment, smoothed
from rover_sweep.diagnosis.simulation.simulator import FittedModel, motion, summed_with_loss

LAGS = np.geomspace(0.2, 5.0, 13)  # s, of the drive: speed controller, motor and mass
ORDER = 3  # of the autoregression
UNSURE = 0.1  # relative standard deviation of the rover's own drag: toe and scrub of the wheels
ID = "speed_variation"
WORSE = "fitted to the runs, but it does not predict the speed of the held-out runs"

Rows = tuple[Array, Array, Array, Array]


@dataclass(frozen=True)
class _Regression:
    """Least squares at one lag: D [s^2/m], its information at a noise of 1, and sums of squares of the speed
    with D and without."""

    loss: float
    information: float
    cost: float
    without: float


@dataclass(frozen=True)
class SpeedLoss:
    """D [s^2/m] with its 90 % interval; lag [s] of the drive; gain: drop of the cost over the noise.

    ratio: residual rms without D/with D. probability: that turns cost speed. drop: largest loss/mean speed.
    noise: variance of the residual speed [m^2/s^2].
    """

    loss: float
    low: float
    high: float
    lag: float
    gain: float
    ratio: float
    probability: float
    drop: float
    noise: float

    @property
    def found(self) -> bool:
        """True if it is sure and D exceeds its material size."""
        effect = library()[ID]
        return self.probability >= SURE and effect.exceeds({effect.key("D"): self.loss}, effect.thresholds)


@dataclass(frozen=True, eq=False)
class Drive:
    """One run (n,): t [s], measured speed [m/s], own drag [m/s^2], a_y^2 [m^2/s^4], heading [rad]."""

    t: Array
    speed: Array
    own: Array
    square: Array
    heading: Array


def speed_loss(runs: Sequence[Experiment], model: Model, x: Values, seed: int) -> SpeedLoss:
    """The speed that cornering cost in these runs. x: {coordinate: value} of the fitted model."""
    drives = [_drive(run, model, x) for run in runs]
    table = [[_rows(drive, float(lag)) for drive in drives] for lag in LAGS]
    white, noise = np.zeros(ORDER), np.inf
    for _ in range(3):
        fits = [_regression(rows, white, noise) for rows in table]
        best = min(range(LAGS.size), key=lambda k: fits[k].cost)
        white = _autoregression(_residuals(table[best], fits[best].loss))
        number = sum(y.size - ORDER - nuisance.shape[1] for y, _, _, nuisance in table[best])
        noise = min(_regression(rows, white, np.inf).cost for rows in table) / max(number - 2, 1)
    return _result(drives, table, [_regression(rows, white, noise) for rows in table], noise, seed)


def _drive(run: Experiment, model: Model, x: Values) -> Drive:
    moved, rover = motion(run, model, x), model.rover
    inertia = np.exp(x["ln_Izz"]) if "ln_Izz" in x else rover.yaw_inertia or rover.mass * rover.a * rover.b
    front = (rover.b * moved["across"] + inertia / rover.mass * moved["r_dot"]) / rover.wheelbase
    own = moved["v"] * moved["r"] - front * np.sin(moved["delta"])
    return Drive(run.t, run.speed, own, moved["across"] ** 2, run.heading)


def _through(u: Array, lag: float) -> Array:
    """Speed change (n,) [m/s] by an acceleration u (n,) [m/s^2] that the drive corrects with the lag [s]."""
    return smoothed(summed_with_loss(u / RATE, float(np.exp(-1.0 / (RATE * lag)))))


def _rows(drive: Drive, lag: float) -> Rows:
    """(speed minus own drag (k,), its change by D = 1 (k,), own drag (k,), nuisances (k, 4)) at the rows."""
    # a row each 0.2 s, since the measured speed is smoothed over 0.25 s; without a second at both ends
    inside = slice(int(RATE), -int(RATE), int(0.2 * RATE))
    own, square = _through(drive.own, lag)[inside], _through(drive.square, lag)[inside]
    uphill = [_through(wave(drive.heading), lag)[inside] for wave in (np.cos, np.sin)]
    nuisance = np.column_stack((np.ones(own.size), np.exp(-drive.t[inside] / lag), *uphill))
    return drive.speed[inside] - own, -square, own, nuisance


def _whitened(rows: Array, white: Array) -> Array:
    before = sum(a * rows[ORDER - 1 - k : rows.shape[0] - 1 - k] for k, a in enumerate(white))
    return np.asarray(rows[ORDER:] - before)


def _regression(runs: Sequence[Rows], white: Array, noise: float) -> _Regression:
    """D >= 0 of all runs at one lag. white (ORDER,): coefficients of the autoregression. noise: of a row."""
    parts = []
    for y, z, own, nuisance in runs:
        left, size, _ = np.linalg.svd(_whitened(nuisance, white), full_matrices=False)
        q = left[:, size > 1e-9 * size[0]]  # a straight drive has one heading
        rows = _whitened(np.column_stack((y, z, own)), white)
        parts.append(rows - q @ (q.T @ rows))
    gram = np.concatenate(parts).T @ np.concatenate(parts)
    gram = gram[:2, :2] - np.outer(gram[2, :2], gram[2, :2]) / (gram[2, 2] + noise / UNSURE**2)
    loss = max(float(gram[0, 1] / gram[1, 1]), 0.0) if gram[1, 1] > 1e-12 else 0.0
    cost = gram[0, 0] - 2.0 * loss * gram[0, 1] + loss**2 * gram[1, 1]
    return _Regression(loss, float(gram[1, 1]), float(cost), float(gram[0, 0]))


def _residuals(runs: Sequence[Rows], loss: float) -> list[Array]:
    """Residual speed (k,) of each run, not whitened, after fitting the nuisances."""
    out = []
    for y, z, _, nuisance in runs:
        residual = y - loss * z
        out.append(residual - nuisance @ np.linalg.lstsq(nuisance, residual, rcond=None)[0])
    return out


def _autoregression(residual: Sequence[Array]) -> Array:
    """Coefficients (ORDER,) of the autoregression of residuals, by least squares."""
    past = np.concatenate(
        [np.column_stack([y[ORDER - k : -k] for k in range(1, ORDER + 1)]) for y in residual]
    )
    now = np.concatenate([y[ORDER:] for y in residual])
    return np.asarray(np.linalg.lstsq(past, now, rcond=None)[0], float)


def _result(
    drives: Sequence[Drive],
    table: Sequence[Sequence[Rows]],
    fits: Sequence[_Regression],
    noise: float,
    seed: int,
) -> SpeedLoss:
    """The loss at the best lag, its probability, and its interval over all possible lags."""
    costs = np.array([f.cost for f in fits])
    best = int(np.argmin(costs))
    loss, lag, without = fits[best].loss, float(LAGS[best]), min(f.without for f in fits)
    gain = (without - costs[best]) / noise
    spread = np.sqrt(noise / np.maximum([f.information for f in fits], 1e-12))
    width = SPAN * np.sqrt(COARSE) * spread[best] / (WIDTH * library()[ID].parameters[0].size)
    weight = np.exp(min(0.5 * gain / COARSE + min(np.log(width), 0.0) + FIRST, 500.0))
    # lags drawn by their likelihood, and for each a loss
    random, draws = np.random.default_rng(seed), 2000
    likely = np.exp(-0.5 * (costs - costs[best]) / noise)
    picked = random.choice(len(fits), draws, p=likely / likely.sum())
    drawn = np.array([f.loss for f in fits])[picked] + random.standard_normal(draws) * spread[picked]
    low, high = np.percentile(np.maximum(drawn, 0.0), (5.0, 95.0))
    return SpeedLoss(
        loss=loss,
        low=float(low),
        high=float(high),
        lag=lag,
        gain=float(gain),
        ratio=float(np.sqrt(without / costs[best])),
        probability=float(weight / (1.0 + weight)),
        drop=max(loss * float(np.max(_through(d.square, lag))) / float(np.mean(d.speed)) for d in drives),
        noise=float(np.var(np.concatenate(_residuals(table[best], loss)))),
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class AtPredictedSpeed(FittedModel):
    """A model that is driven at a predicted speed instead of the measured one.

    loss: D [s^2/m]; lag [s] of the drive.
    """

    loss: float
    lag: float

    def speed(self, run: Experiment) -> Array:
        """Speed (n,) [m/s] predicted from own drag and this loss, about the run's mean."""
        drive = _drive(run, self.model, self.x)
        taken = _through(drive.own - self.loss * drive.square, self.lag)
        return float(np.mean(run.speed)) + taken - float(np.mean(taken))

    def log(self, run: Experiment) -> dict[str, Array]:
        """The simulated log of the run at that speed {channel: (n,)}."""
        return super().log(replace(run, speed=self.speed(run)))


def speed_finding(found: SpeedLoss, whole: FittedModel, unused: Sequence[HeldOutRun]) -> Finding:
    """The loss as a finding. whole: the model with all other effects; unused: the held-out runs."""
    effect = library()[ID]
    unit, meaning = effect.parameters[0].unit, effect.parameters[0].convention
    value = Quantity("D", unit, found.loss, found.low, found.high, meaning)
    without, with_it = (
        AtPredictedSpeed(whole.model, whole.x, loss=d, lag=found.lag) for d in (0.0, found.loss)
    )
    sentence = (
        f"{effect.title}, D = {found.loss:.3g} {unit}: up to {100 * found.drop:.1f} % of the speed "
        f"(lag of the drive: {found.lag:.1f} s)"
    )
    shown = tuple(_held_out(held, without, with_it, found.noise) for held in unused)
    return Finding(
        ID,
        (),
        ByName((value,)),
        {"gain": found.gain},
        shown,
        effect.next_run,
        sentence,
        effect.equation,
        probability=found.probability,
    )


def earned(found: Finding) -> bool:
    """False if the loss removes less than 5 % of the speed's error on average over the held-out runs.

    An absent loss removed 0.3 %. A run that is at the noise without the loss counts against it.
    """
    shares = [h.share_removed or 0.0 for h in found.held_out]
    return not shares or sum(shares) / len(shares) > 0.05


def unknown_loss(found: SpeedLoss) -> Unknown:
    """The same loss as an unknown, if the effect is not a candidate."""
    return Unknown(
        "V",
        "a_y",
        found.ratio,
        f"turns cost up to {100 * found.drop:.1f} % of the speed, in proportion to a_y^2 and more than the "
        "drag of the turned wheels; no candidate explains it",
        "V' ~ a_y^2",
    )


def _held_out(
    held: HeldOutRun, without: AtPredictedSpeed, with_it: AtPredictedSpeed, noise: float
) -> HeldOut:
    """J_rms and TIC of models driven at the predicted speeds; the share is that of the speed's own error."""
    run = held.run
    before, after = (float(np.var(run.speed - m.speed(run))) for m in (without, with_it))
    share = (before - after) / (before - noise) if before > noise else None
    return HeldOut(run.name, fit_of(held, without), fit_of(held, with_it), share)
