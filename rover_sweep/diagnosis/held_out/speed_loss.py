"""Speed that cornering costs in addition to the drag of the turned wheels, from the measured speed.

    V' = (V_set - V)/tau - Ff sin(d)/m + v r - D a_y^2

Every rover has the first three terms; Ff sin(d) and v r come from the fitted model. D is the finding.

For each lag tau of a grid, the speed minus its own drag is regressed on the response to a_y^2 with a constant
and the decay of the initial speed as nuisances. The noise of a measured speed is slow, so the rows are
whitened by an autoregression of the residual, estimated three times in turn with D (Cochrane and Orcutt
1949). The threshold comes from random draws of that noise and of the drag's own uncertainty, with the best
lag chosen in each draw as in the data.

The finding is kept where held-out runs, driven at the speed that it predicts, confirm it.

Cochrane and Orcutt 1949: Application of least squares regression to relationships containing
auto-correlated error terms, J. American Statistical Association 44(245).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rover_sweep.data.by_name import ByName
from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.effects import library
from rover_sweep.diagnosis.held_out.worth import FittedModel, HeldOutRun, fit_of
from rover_sweep.diagnosis.result import EffectValue, Finding, HeldOut, Unknown
from rover_sweep.diagnosis.simulation.experiment import RATE, Experiment, smoothed
from rover_sweep.diagnosis.simulation.kernel import summed_with_loss
from rover_sweep.diagnosis.simulation.simulator import motion
from rover_sweep.diagnosis.simulation.structure import Structure, Values

LAGS = np.geomspace(0.2, 5.0, 13)  # s, of the drive: speed controller, motor and mass
ORDER = 3  # of the autoregression
UNSURE = 0.1  # relative standard deviation of the rover's own drag: toe and scrub of the wheels
FALSE_ALARMS = 0.003  # for one effect among two dozen
ID = "speed_variation"
WORSE = "fitted to the runs, but it does not predict the speed of the held-out runs"

Rows = tuple[Array, Array, Array, Array]


@dataclass(frozen=True, eq=False)
class _Regression:
    """Least squares at one lag; whitened rows (n,) without the nuisances.

    cost: sum of squares. loss: D [s^2/m]. speed, per_loss, own: speed minus own drag, its change by D = 1,
    the own drag.
    """

    cost: float
    loss: float
    speed: Array
    per_loss: Array
    own: Array


@dataclass(frozen=True)
class SpeedLoss:
    """D [s^2/m] with its 90 % interval; lag [s] of the drive; gain (drop of the cost) and its threshold.

    drop: largest loss over the mean speed. noise: variance of the residual speed [m^2/s^2].
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
        """True where the gain is above its threshold and D above its material size."""
        effect = library()[ID]
        return self.gain > self.threshold and effect.exceeds({effect.key("D"): self.loss}, effect.thresholds)


@dataclass(frozen=True, eq=False)
class Drive:
    """One run (n,): t [s], measured speed [m/s], own drag [m/s^2] and a_y^2 [m^2/s^4]."""

    t: Array
    speed: Array
    own: Array
    square: Array


def speed_loss(runs: Sequence[Experiment], structure: Structure, x: Values, seed: int) -> SpeedLoss:
    """The speed that cornering cost in these runs. x: {coordinate: value} of the fitted model."""
    drives = [_drive(run, structure, x) for run in runs]
    table = [[_rows(drive, float(lag)) for drive in drives] for lag in LAGS]
    white = np.zeros(ORDER)
    for _ in range(3):
        fits = [_regression(rows, white) for rows in table]
        best = min(range(LAGS.size), key=lambda k: fits[k].cost)
        white = _autoregression(_residuals(table[best], fits[best].loss))
    fits = [_regression(rows, white) for rows in table]
    return _result(drives, table, fits, seed)


def _drive(run: Experiment, structure: Structure, x: Values) -> Drive:
    moved, rover = motion(run, structure, x), structure.rover
    inertia = np.exp(x["ln_Izz"]) if "ln_Izz" in x else rover.yaw_inertia or rover.mass * rover.a * rover.b
    front = (rover.b * moved["across"] + inertia / rover.mass * moved["r_dot"]) / rover.wheelbase
    return Drive(
        run.t, run.speed, moved["v"] * moved["r"] - front * np.sin(moved["delta"]), moved["across"] ** 2
    )


def _through(u: Array, lag: float) -> Array:
    """Speed change (n,) [m/s] by an acceleration u (n,) [m/s^2] that the drive corrects with the lag [s]."""
    return smoothed(summed_with_loss(u / RATE, float(np.exp(-1.0 / (RATE * lag)))))


def _rows(drive: Drive, lag: float) -> Rows:
    """(speed minus own drag (k,), its change by D = 1 (k,), own drag (k,), nuisances (k, 2)) at the rows."""
    # a row each 0.2 s, since the measured speed is smoothed over 0.25 s; without a second at both ends
    inside = slice(int(RATE), -int(RATE), int(0.2 * RATE))
    own, square = _through(drive.own, lag)[inside], _through(drive.square, lag)[inside]
    beginning = np.exp(-drive.t[inside] / lag)
    return drive.speed[inside] - own, -square, own, np.column_stack((np.ones(own.size), beginning))


def _whitened(rows: Array, white: Array) -> Array:
    before = sum(a * rows[ORDER - 1 - k : rows.shape[0] - 1 - k] for k, a in enumerate(white))
    return np.asarray(rows[ORDER:] - before)


def _regression(runs: Sequence[Rows], white: Array) -> _Regression:
    """D >= 0 of all runs at one lag. white (ORDER,): coefficients of the autoregression."""
    parts = []
    for y, z, own, nuisance in runs:
        q = np.linalg.qr(_whitened(nuisance, white))[0]
        rows = _whitened(np.column_stack((y, z, own)), white)
        parts.append(rows - q @ (q.T @ rows))
    y, z, own = np.concatenate(parts).T
    power = float(z @ z)
    loss = max(float(y @ z) / power, 0.0) if power > 1e-12 else 0.0
    return _Regression(float(np.sum((y - loss * z) ** 2)), loss, y, z, own)


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
    return np.asarray(np.linalg.lstsq(past, now, rcond=None)[0])


def _result(
    drives: Sequence[Drive], table: Sequence[Sequence[Rows]], fits: Sequence[_Regression], seed: int
) -> SpeedLoss:
    """The loss at the best lag, with its threshold and the interval over all lags that are possible."""
    costs = np.array([f.cost for f in fits])
    best = int(np.argmin(costs))
    rows = fits[best].speed.size
    noise = costs[best] / max(rows - 2 * len(drives) - 2, 1)
    without_loss = min(float(f.speed @ f.speed) for f in fits)
    random, draws = np.random.default_rng(seed), 2000
    units = np.column_stack([f.per_loss / (np.linalg.norm(f.per_loss) or 1.0) for f in fits])
    own = fits[best].own
    chance = random.standard_normal((draws, rows)) * np.sqrt(noise)
    chance += UNSURE * random.standard_normal((draws, 1)) * own
    gains = np.max(np.maximum(chance @ units, 0.0), axis=1) ** 2 / noise
    # lags drawn by their likelihood, and for each a loss
    weights = np.exp(-0.5 * (costs - costs[best]) / noise)
    picked = random.choice(len(fits), draws, p=weights / weights.sum())
    sizes = np.array([np.sqrt(f.per_loss @ f.per_loss) for f in fits])
    pull = np.array([f.own @ f.per_loss / (f.per_loss @ f.per_loss) for f in fits])
    centre = np.array([f.loss for f in fits])
    drawn = centre[picked] + random.standard_normal(draws) * np.sqrt(noise) / sizes[picked]
    drawn += UNSURE * random.standard_normal(draws) * pull[picked]
    low, high = np.percentile(np.maximum(drawn, 0.0), (5.0, 95.0))
    lag, loss = float(LAGS[best]), fits[best].loss
    drop = max(loss * float(np.max(_through(d.square, lag))) / float(np.mean(d.speed)) for d in drives)
    return SpeedLoss(
        loss=loss,
        low=float(low),
        high=float(high),
        lag=lag,
        gain=float(without_loss - costs[best]) / noise,
        threshold=float(np.quantile(gains, 1.0 - FALSE_ALARMS)),
        drop=drop,
        noise=float(np.var(np.concatenate(_residuals(table[best], loss)))),
    )


@dataclass(frozen=True, eq=False)
class AtPredictedSpeed(FittedModel):
    """A model that is driven at a predicted speed instead of the measured one.

    loss: D [s^2/m]; lag [s] of the drive.
    """

    loss: float
    lag: float

    def speed(self, run: Experiment) -> Array:
        """The speed (n,) [m/s] by the rover's own drag and this loss, about the run's mean."""
        drive = _drive(run, self.model.structure, self.x)
        taken = _through(drive.own - self.loss * drive.square, self.lag)
        return float(np.mean(run.speed)) + taken - float(np.mean(taken))

    def log(self, run: Experiment) -> dict[str, Array]:
        """The simulated log of the run at that speed {channel: (n,)}."""
        return super().log(replace(run, speed=self.speed(run)))


def speed_finding(found: SpeedLoss, whole: FittedModel, unused: Sequence[HeldOutRun]) -> Finding:
    """The loss as a finding. whole: the model with all other effects; unused: the held-out runs."""
    effect = library()[ID]
    unit, meaning = effect.parameters[0].unit, effect.parameters[0].convention
    value = EffectValue("D", unit, found.loss, found.low, found.high, meaning)
    without, with_it = (AtPredictedSpeed(whole.model, whole.x, d, found.lag) for d in (0.0, found.loss))
    sentence = (
        f"{effect.title}, D = {found.loss:.3g} {unit}: up to {100 * found.drop:.1f} % of the speed "
        f"(lag of the drive: {found.lag:.1f} s)"
    )
    shown = tuple(_held_out(held, without, with_it, found.noise) for held in unused)
    return Finding(
        ID,
        (),
        ByName((value,)),
        {"gain": found.gain, "threshold": found.threshold},
        shown,
        effect.next_run,
        sentence,
        effect.equation,
    )


def earned(found: Finding) -> bool:
    """False where held-out runs judge the loss, and it removes less than 5 % of the speed's error on average.

    A loss that is not there removed 0.3 %.
    """
    shares = [h.share_removed for h in found.held_out if h.share_removed is not None]
    return not shares or sum(shares) / len(shares) > 0.05


def unknown_loss(found: SpeedLoss) -> Unknown:
    """The same loss as an unknown, where the effect is not among the candidates."""
    times = float(np.sqrt(found.gain / found.threshold))
    return Unknown(
        "V",
        "a_y",
        times,
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
