"""A law for the yaw rate from the steering, fitted to any recorded driving.

    r(t) = b + F{ V g w / (1 + k V^2 + q a^2) },   a = V^2 g w
    w = x (1 + h sgn(x) + s (x/X)^2),              x = u(t - tau) - u0

u is the recorded steering output, V the speed, g the curvature that a unit of steering gives at low speed
(1/m per us, or 1/m per rad = 1/L), u0 the output that drives straight, b the bias of the gyro. k = K_us/L is
the understeer: 1/sqrt(k) is the characteristic speed, for k < 0 1/sqrt(-k) the critical one (Milliken, Race
Car Vehicle Dynamics, ch. 5). q is how much less the rover turns in hard turns, as tyres bend. The
steering curve: h is how much more it turns to the side of larger outputs, s how much more than in proportion
at the amplitude X of this driving, as the tangent of the angle does, or less, as a linkage near its end. F is
two lags in series and the known low-pass of the gyro: T of the steering, and c V/(1 + k V^2) of the tyres;
the neutral bicycle model's yaw rate follows the steering exactly so, with c = Izz/(a^2 Cf + b^2 Cr). No mass,
length or steering ratio is needed.

The recording is part of the law. Between samples of a steering that was logged seldom, u goes a share
`smooth` of the way from straight lines to a cubic spline. A steering that steps between samples does so at a
common `phase` of their interval, which hides the delay. A yaw rate that was sampled seldom is compared at its
samples. A low-pass of the gyro that is not known is between the slowest usual one and none.

Road and wind make an error that is not white: it is whitened by an autoregression of the residual (Ljung,
System Identification, 7.3), and the covariance counts blocks of `BLOCK` seconds as the independent pieces
(Liang and Zeger 1986), so that repetition in a turn is not counted as new.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.signal import butter, lfilter, lfilter_zi
from scipy.stats import t as student

from rover_sweep.data.recording import Array, LowPass
from rover_sweep.driving.stretches import RATE, DrivenPart

BLOCK, SHORT_BLOCK = 5.0, 2.0  # s, longer than a turn's memory; the shorter one in short driving
BLOCKS = 24  # fewest, before they become shorter
ORDER = 6  # of the autoregression
ENOUGH = 1e-6  # relative change of cost or parameters at which a search ends; slow where one is at its bound
FAST_HZ = 10.0  # of the gyro's low-pass
SPLIT = 0.18  # sd of the share of the lags that may be a delay instead, or the reverse: they look alike
OTHER = 0.01  # sd of the share by which the gain changes with the speed for other reasons than understeer
LINEAR = 0.1  # sd of the understeer, as a share: the lag of a rover that is not neutral is not of first order
SPEED_ERROR = 0.015  # m/s, by which a recorded speed may be wrong throughout, as an estimator's in slow turns
TYRES = 0.08  # sd of the lag of the tyres, as a share, since they bend
WHOLE = 0.02  # sd of delay and lags together, as a share: the law is simpler than a rover
SETTLED = round(1.0 * RATE)  # samples at the begin of a stretch, in which the lags' unknown start decays
PIECE = 20.0  # s, of the pieces that are predicted from the others
UNEVEN = 0.02  # share of the steering in one half, below which the pieces are shorter: `BLOCK`
FARTHEST = 2.0  # amplitudes, up to which the steering curve bends
WAY = 0.3  # sd of how far the way between samples is from any mixture of a straight line and a spline
LIMIT = 4.0  # of the whitened error, in its sd; beyond it, a sample counts less (Huber)

NAMES = (
    *("gain", "straight", "bias", "delay", "lag", "tyre_lag"),
    *("understeer", "bend", "side", "curve", "smooth", "phase"),
)
SMOOTH, PHASE = NAMES.index("smooth"), NAMES.index("phase")
LOW = np.array([-np.inf, -np.inf, -np.inf, 0.0, 0.0, 0.0, -np.inf, 0.0, -0.5, -0.5, -0.5, -0.5])
HIGH = np.array([np.inf, np.inf, np.inf, 0.6, 0.6, 0.3, 1.0, 0.06, 0.5, 0.5, 1.5, 0.5])
USUAL = np.array([0.0, 0.0, 0.0, 0.05, 0.05, 0.04, 0.0, 0.0, 0.0, 0.0, 0.5, 0.0])
SPREAD = np.array([np.inf, np.inf, 0.02, 0.2, 0.2, 0.1, 0.1, 0.03, 0.05, 0.05, 0.5, 0.5])
"""Mean and standard deviation over rovers: wide, so they affect only numbers that driving leaves open."""
Known = Mapping[str, tuple[float, float]]
"""{name: (value, standard deviation)} known beforehand."""
OF_SPEED = ("tyre_lag", "understeer", "curve")  # only driving at several speeds shows these


@dataclass(frozen=True, eq=False)
class DrivingFit:
    """values (12,) and their covariance (12, 12) in the order of NAMES, zero for held names.

    structure (12, 12): covariance of the law's own errors, which more driving does not reduce.

    gain g [1/m per unit of steering], straight u0 [unit of steering], bias b [rad/s], delay tau [s], lag T
    [s], tyre_lag c [s^2/m], understeer k [s^2/m^2], bend q [s^4/m^2], side h and curve s [-], smooth [-] and
    phase [intervals between samples, from their middle] of a steering that was logged seldom. amplitude: X
    [unit of steering]. held: names that this driving cannot show. explained: share of the yaw rate's
    variance that the model gives in pieces it was not fitted to.
    dof: independent blocks beyond the parameters.
    """

    values: Array
    covariance: Array
    structure: Array
    amplitude: float
    held: tuple[str, ...]
    explained: float
    dof: int

    def __getitem__(self, name: str) -> float:
        return float(self.values[NAMES.index(name)])

    def interval(self, slopes: dict[str, float], value: float) -> tuple[float, float]:
        """90 % interval of a value with these derivatives {name: slope} to the parameters."""
        s = np.array([slopes.get(name, 0.0) for name in NAMES])
        half = float(student.ppf(0.95, self.dof) * np.sqrt(s @ (self.covariance + self.structure) @ s))
        return value - half, value + half


def fit_driving(
    stretches: Sequence[DrivenPart], known: Known, held: Sequence[str] = OF_SPEED, speed_sd: float = 0.0
) -> DrivingFit:
    """Fits all stretches together. known: prior knowledge of some. held: names kept at 0. speed_sd: of the
    logarithm of the speed's scale.

    ValueError where no stretch is longer than `SETTLED` samples.
    """
    problem = _Problem(stretches, known, held)
    theta, of_low_pass = _whatever_low_pass(problem)
    covariance, dof = problem.covariance(theta)
    structure = _structure(theta, problem.stretches) + problem.of_speed_error(theta)
    structure = structure + _of_speed_scale(theta, speed_sd) + problem.of_way(theta) + of_low_pass
    explained = _explained(stretches, known, held)
    return DrivingFit(theta, covariance, structure, problem.amplitude, tuple(held), explained, dof)


def precision_with(
    fit: DrivingFit, stretches: Sequence[DrivenPart], known: Known, more: DrivenPart
) -> DrivingFit:
    """The fit with the covariance that it would have if `more` had been driven too, with equal errors."""
    problem = _Problem(stretches, known, fit.held)
    problem.whiten(fit.values)
    problem.stretches, before = (more,), problem.free
    slopes = problem.slopes(fit.values)[: more.t.size - SETTLED]
    covariance = np.zeros_like(fit.covariance)
    place = np.ix_(before, before)
    covariance[place] = np.linalg.inv(np.linalg.pinv(fit.covariance[place]) + slopes.T @ slopes)
    return replace(fit, covariance=covariance)


def fitted_yaw_rate(fit: DrivingFit, s: DrivenPart) -> Array:
    """The fit's yaw rate (n,) rad/s."""
    return _yaw_rate(s, fit.values, fit.amplitude)


class _Problem:
    """Residuals of the model, whitened by the inverse noise filter `white` (ORDER + 1,) with sd `sd`."""

    def __init__(self, stretches: Sequence[DrivenPart], known: Known, held: Sequence[str]) -> None:
        self.stretches = tuple(s for s in stretches if s.t.size > 2 * SETTLED)
        if not self.stretches:
            raise ValueError("no stretch of driving is long enough")
        self.free = np.array([name not in held for name in NAMES])
        self.free[SMOOTH] = any(s.between and not s.in_steps for s in self.stretches)
        self.free[PHASE] = any(s.in_steps for s in self.stretches)
        steering = np.concatenate([s.steered(0.0) for s in self.stretches])
        self.unit = max(float(np.std(steering)), 1e-9)
        self.amplitude = max(float(np.percentile(np.abs(steering - np.median(steering)), 95)), self.unit)
        self.usual, self.spread = USUAL.copy(), SPREAD.copy()
        self.usual[1], self.spread[1] = float(np.median(steering)), 10 * self.unit
        for name, (value, sd) in known.items():
            k = NAMES.index(name)
            self.usual[k], self.spread[k] = value, sd
        fastest = max(float(np.max(np.abs(s.v))) for s in self.stretches)
        self.low = LOW.copy()
        self.low[6] = -0.8 / fastest**2
        self.white, self.sd = np.array([1.0]), 1.0
        self.scale = np.array(
            [1 / self.unit, self.unit, 0.01, 0.03, 0.03, 0.03, 0.3 / fastest**2, 0.01, 0.05, 0.05, 0.2, 0.2]
        )

    def solved(self) -> Array:
        """The parameters (12,) of the least squares, whitened three times; the best of several starts."""
        starts = [
            min((self._start(delay, lag) for lag in (0.05, 0.2)), key=self._cost)
            for delay in (0.0, 0.1, 0.25)
        ]  # with a steering that swings, a delay of a period more is a minimum too
        theta = min((self.searched(start) for start in starts), key=lambda found: found[1])[0]
        for _ in range(3):
            self.whiten(theta)
            theta = self.searched(theta)[0]
        return theta

    def _start(self, delay: float, lag: float) -> Array:
        """With the gain of a regression at this delay and lag."""
        theta = np.where(self.free, self.usual, 0.0)
        theta[[0, 3, 4]] = 1 / self.unit, delay, lag
        theta[1] = self.usual[1]
        models = (s.at_samples(_yaw_rate(s, theta, self.amplitude)) for s in self.stretches)
        x = np.concatenate([x[_settled(s) :] for x, s in zip(models, self.stretches, strict=True)])
        y = np.concatenate([s.measured[_settled(s) :] for s in self.stretches])
        theta[0] *= float(x @ y / max(x @ x, 1e-12))
        return theta

    def searched(self, start: Array) -> tuple[Array, float]:
        """The parameters (12,) of the least squares that a start (12,) leads to, and their cost."""
        free = self.free

        def errors(x: Array) -> Array:
            theta = start.copy()
            theta[free] = x
            return self._errors(theta)

        x0 = np.clip(start, self.low + 1e-9, HIGH - 1e-9)[free]
        bounds = self.low[free], HIGH[free]
        found = least_squares(
            errors,
            x0,
            bounds=bounds,
            x_scale=self.scale[free],
            loss="huber",
            f_scale=LIMIT,
            ftol=ENOUGH,
            xtol=ENOUGH,
        )
        theta = start.copy()
        theta[free] = found.x
        return theta, float(found.cost)

    def _cost(self, theta: Array) -> float:
        return float(np.sum(np.square(self._errors(theta))))

    def _errors(self, theta: Array) -> Array:
        """Whitened errors of all stretches in their sd (n,), and those of the priors (12,)."""
        parts = [
            np.asarray(lfilter(self.white, [1.0], _error(s, theta, self.amplitude)))[_settled(s) :] / self.sd
            for s in self.stretches
        ]
        return np.concatenate((*parts, (theta - self.usual) / self.spread))

    def whiten(self, theta: Array) -> None:
        """The autoregression of the residuals, by least squares over all stretches."""
        residuals = [_error(s, theta, self.amplitude)[_settled(s) :] for s in self.stretches]
        long = [e for e in residuals if e.size > 2 * ORDER]
        if not long:
            self.white, self.sd = np.array([1.0]), max(float(np.std(np.concatenate(residuals))), 1e-9)
            return
        residuals, lags = long, range(1, ORDER + 1)
        x = np.concatenate([np.stack([e[ORDER - k : e.size - k] for k in lags], 1) for e in residuals])
        y = np.concatenate([e[ORDER:] for e in residuals])
        found = np.linalg.lstsq(x, y, rcond=None)[0]
        self.white = np.concatenate(([1.0], -found))
        self.sd = max(float(np.std(y - x @ found)), 1e-9)

    def covariance(self, theta: Array) -> tuple[Array, int]:
        """Covariance (12, 12) by blocks, not below what independent errors leave; spare blocks."""
        errors = self._errors(theta)
        weight = np.minimum(1.0, LIMIT / np.maximum(np.abs(errors), 1e-12))
        j = self.slopes(theta) * np.sqrt(weight)[:, None]
        errors = errors * np.sqrt(weight)
        bread = np.linalg.pinv(j.T @ j)
        owner = self._owners()
        sums = np.zeros((int(owner.max()) + 1, j.shape[1]))
        np.add.at(sums, owner, (j * errors[:, None])[: owner.size])
        dof = max(len(sums) - j.shape[1], 1)
        blocks = bread @ (sums.T @ sums) @ bread * len(sums) / dof
        least = np.sqrt(np.maximum(np.diag(bread) / np.maximum(np.diag(blocks), 1e-300), 1.0))
        found = np.zeros((len(NAMES), len(NAMES)))
        found[np.ix_(self.free, self.free)] = blocks * np.outer(least, least)
        return found, dof

    def slopes(self, theta: Array) -> Array:
        """Derivatives (n, free) of the errors."""
        columns = []
        for i in np.flatnonzero(self.free):
            ahead, behind = theta.copy(), theta.copy()
            ahead[i] = min(theta[i] + 0.01 * self.scale[i], HIGH[i])
            behind[i] = max(theta[i] - 0.01 * self.scale[i], self.low[i])
            columns.append((self._errors(ahead) - self._errors(behind)) / (ahead[i] - behind[i]))
        return np.stack(columns, 1)

    def of_speed_error(self, theta: Array) -> Array:
        """Covariance (12, 12) of what `SPEED_ERROR` does to the parameters."""
        step = self._moved(theta, [replace(s, v=s.v + SPEED_ERROR * np.sign(s.v)) for s in self.stretches])
        return np.outer(step, step)

    def of_way(self, theta: Array) -> Array:
        """Covariance (12, 12) of what `WAY` does to the parameters."""
        if not self.free[SMOOTH]:
            return np.zeros((len(NAMES), len(NAMES)))
        other = theta.copy()
        other[SMOOTH] += WAY
        of_others = self.free.copy()
        of_others[SMOOTH] = False
        step = self._explaining(theta, self._errors(other) - self._errors(theta), of_others)
        return np.outer(step, step)

    def _moved(self, theta: Array, stretches: Sequence[DrivenPart]) -> Array:
        """How far (12,) the parameters move if the driving was another one, by one step of the search."""
        exact, right = self._errors(theta), self.stretches
        self.stretches = tuple(stretches)
        moved = self._errors(theta)
        self.stretches = right
        return self._explaining(theta, moved - exact, self.free)

    def _explaining(self, theta: Array, more: Array, of: NDArray[np.bool_]) -> Array:
        """The step (12,) of these parameters (12,) that takes back these errors (n,)."""
        step: Array = np.zeros(len(NAMES))
        step[of] = np.linalg.lstsq(self.slopes(theta)[:, of[self.free]], -more, rcond=None)[0]
        return step

    def _owners(self) -> np.ndarray:
        """The block (n,) of each error of the stretches."""
        found, first = [], 0
        seconds = sum(s.t.size - SETTLED for s in self.stretches) / RATE
        block = min(BLOCK, max(SHORT_BLOCK, seconds / BLOCKS))
        for s in self.stretches:
            k = np.arange(s.measured.size - _settled(s)) // round(block * s.rate)
            found.append(first + k)
            first += int(k[-1]) + 1
        return np.concatenate(found)


def _whatever_low_pass(problem: _Problem) -> tuple[Array, Array]:
    """The parameters (12,), and the covariance (12, 12) of a gyro's low-pass that is not known.

    It is between the slowest usual one and none, and these two are the likeliest: the spread of a sine.
    """
    right, middle = problem.stretches, problem.solved()
    unknown = [s.behind_an_end(slowest=True).low_pass for s in right if s.low_pass_unknown]
    if not unknown:
        return middle, np.zeros((len(NAMES), len(NAMES)))
    if late := min(_constant_delay(slowest) for slowest in unknown):  # fast ones: a delay, or a lag
        half = np.zeros(len(NAMES))
        half[3] = min(0.5 * late, middle[3])
        half[4] = 0.5 * late - half[3]
        return middle, np.outer(half, half) / 2
    ends = []
    for slowest in (True, False):
        problem.stretches = tuple(s.behind_an_end(slowest) for s in right)
        ends.append(problem.searched(middle)[0])
    problem.stretches = right
    theta = 0.5 * (ends[0] + ends[1])
    problem.whiten(theta)
    half = 0.5 * (ends[0] - ends[1]) / np.sqrt(2)
    return theta, np.outer(half, half)


def _structure(theta: Array, stretches: Sequence[DrivenPart]) -> Array:
    """Covariance (12, 12) of what the law leaves out: `SPLIT`, `WHOLE`, `TYRES`, `OTHER` and `LINEAR`."""
    speeds = np.concatenate([np.abs(s.v) for s in stretches])
    lags = theta[4] + theta[5] * float(np.mean(speeds))
    found = np.zeros((len(NAMES), len(NAMES)))
    found[np.ix_((3, 4), (3, 4))] = (SPLIT * lags) ** 2 * np.array([[1.0, -1.0], [-1.0, 1.0]])
    found[4, 4] += (WHOLE * (theta[3] + lags)) ** 2
    # what the tyres' lag gains, the constant one loses
    bent: Array = np.zeros(len(NAMES))
    bent[5] = TYRES * theta[5]
    bent[4] = -bent[5] * float(np.mean(speeds))
    found += np.outer(bent, bent)
    # what the understeer gains, the gain at low speed gains too: that of the usual speed stays
    moved: Array = np.zeros(len(NAMES))
    moved[6] = np.hypot(OTHER / float(np.percentile(speeds, 95)) ** 2, LINEAR * theta[6])
    moved[0] = theta[0] * moved[6] * float(np.median(np.square(speeds)))
    found += np.outer(moved, moved)
    return found


def _of_speed_scale(theta: Array, sd: float) -> Array:
    """Covariance (12, 12) of a speed that is wrong by a factor, of which `sd` is that of the logarithm.

    The law is the same for s V with g/s, c/s, k/s^2 and, as a is V r, q/s^2.
    """
    moved = np.zeros(len(NAMES))
    for name, power in (("gain", 1), ("tyre_lag", 1), ("understeer", 2), ("bend", 2)):
        k = NAMES.index(name)
        moved[k] = power * theta[k] * sd
    return np.outer(moved, moved)


def _explained(stretches: Sequence[DrivenPart], known: Known, held: Sequence[str]) -> float:
    """Share of the variance explained, each half of the driving predicted by the fit to the other."""
    halves = _halves(stretches, PIECE)
    if min(map(_steered, halves)) < UNEVEN * sum(map(_steered, halves)):  # as in one short manoeuvre
        halves = _halves(stretches, BLOCK)
    error = total = 0.0
    for fitted, other in (halves, reversed(halves)):
        problem = _Problem(fitted, known, held)
        theta = problem.solved()
        for s in other:
            error += float(np.sum(np.square(_error(s, theta, problem.amplitude))[_settled(s) :]))
            total += float(np.sum(np.square(s.measured - theta[2])[_settled(s) :]))
    return 1.0 - error / total if total else 0.0


def _halves(stretches: Sequence[DrivenPart], length: float) -> list[list[DrivenPart]]:
    """Every other piece of about `length` [s], and the others."""
    pieces = [(k + i, part) for i, s in enumerate(stretches) for k, part in enumerate(_pieces(s, length))]
    return [[part for k, part in pieces if k % 2 == half] for half in (0, 1)]


def _steered(parts: Sequence[DrivenPart]) -> float:
    """How much these parts show of the steering: the sum of V^2 u^2, u from its median, once settled."""
    straight = float(np.median(np.concatenate([s.steered(0.0) for s in parts])))
    turning = [np.square(s.v * (s.steered(0.0) - straight))[SETTLED:] for s in parts]
    return float(np.sum(np.concatenate(turning)))


def _pieces(s: DrivenPart, length: float) -> list[DrivenPart]:
    count = max(2, round(s.seconds / length))
    return [replace(s, t=s.t[k], v=s.v[k], r=s.r[k]) for k in np.array_split(np.arange(s.t.size), count)]


def _error(s: DrivenPart, theta: Array, amplitude: float) -> Array:
    """The samples of the yaw rate less the model's (m,) rad/s."""
    return s.measured - s.at_samples(_yaw_rate(s, theta, amplitude))


def _settled(s: DrivenPart) -> int:
    """Samples of the yaw rate in the first `SETTLED` of the grid."""
    return round(SETTLED / RATE * s.rate)


def _yaw_rate(s: DrivenPart, theta: Array, amplitude: float) -> Array:
    """The yaw rate (n,) rad/s of the module's text, starting at rest in the first sample."""
    gain, straight, bias, delay, lag, tyre_lag, understeer, bend, side, curve, smooth, phase = theta
    square = np.square(s.v)
    x = s.steered(delay + phase * s.between * s.in_steps + _constant_delay(s.low_pass), smooth) - straight
    asked = gain * x * (1 + side * np.sign(x) + curve * reached(x, amplitude))
    steady = s.v * asked / (1 + understeer * square + bend * np.square(square * asked))
    slow = tyre_time(tyre_lag, understeer, s.v)
    return bias + _low_passed(_lagged(steady, lag, slow, 1 / RATE), s.low_pass)


def reached(x: Array, amplitude: float) -> Array:
    """(x/X)^2 (n,) of the steering curve, constant beyond `FARTHEST`."""
    return np.asarray(np.square(np.minimum(np.abs(x) / amplitude, FARTHEST)))


def tyre_time(tyre_lag: float, understeer: float, v: Array) -> Array:
    """Time constant (n,) s of the yaw rate at the speeds v (n,) m/s."""
    return np.asarray(tyre_lag * np.abs(v) / (1 + understeer * np.square(v)))


@njit(cache=True)
def _lagged(x, lag, tyre_lag, step):  # type: ignore[no-untyped-def]
    """Two first-order lags in series, of constant and of varying time constant (n,) s; exact for a ramp."""
    y = np.empty_like(x)
    first = second = before = x[0]
    for i in range(x.size):
        then = first
        first = _step(first, before, x[i], lag, step)
        second = _step(second, then, first, tyre_lag[i], step)
        before = x[i]
        y[i] = second
    return y


@njit(cache=True)
def _step(y, before, now, lag, step):  # type: ignore[no-untyped-def]
    """A first-order lag behind an input that goes evenly from `before` to `now` within a step."""
    if lag < 1e-4:
        return now
    behind = (now - before) * lag / step
    return now - behind + (y - before + behind) * np.exp(-step / lag)


def _constant_delay(low_pass: LowPass | None) -> float:
    """The delay [s] of a fast low-pass, which is constant over all that driving excites."""
    if low_pass is None or low_pass.cutoff_hz < FAST_HZ:
        return 0.0
    return float(np.sqrt(2) / (2 * np.pi * low_pass.cutoff_hz))


def _low_passed(x: Array, low_pass: LowPass | None) -> Array:
    """Behind a sensor's second-order low-pass, as ArduPilot computes it, if that is slow."""
    if low_pass is None or low_pass.cutoff_hz >= FAST_HZ:
        return x
    b, a = butter(2, low_pass.cutoff_hz, fs=RATE)
    return np.asarray(lfilter(b, a, x, zi=lfilter_zi(b, a) * x[0])[0])
