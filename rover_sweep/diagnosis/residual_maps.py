"""The residual of a model in multiples of the noise: by band, over time, on signals, and in words."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import fdtrc, ndtr

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.problem.noise_floor import HARMONICS, quiet_frames
from rover_sweep.diagnosis.problem.residuals import MEANS, Problem
from rover_sweep.diagnosis.result import Mismatch, Profile
from rover_sweep.diagnosis.simulation.candidates import same_speed
from rover_sweep.diagnosis.simulation.experiment import RATE, Experiment

LARGE = 2**0.5  # rms over noise from which a place is reported: the misfit is then as large as the noise
SIGMAS = 4.0  # standard deviations from which a value is significant
EDGES: Array = np.geomspace(0.3, 76.0, 17)  # rad/s, half octaves


@dataclass(frozen=True, eq=False)
class Residual:
    """The whitened residual of one channel of one run.

    x (n,): measured minus model on the run's grid. noise (n,): variance of x by noise alone, smaller at both
    ends because of the taper. density: its one-sided variance per Hz between the ends. low, high [rad/s]: its
    band.
    """

    run: Experiment
    channel: str
    x: Array
    noise: Array
    density: float
    low: float
    high: float


def residuals_of(problem: Problem, rows: Array, channel: str) -> list[Residual]:
    """The channel's residual in each run that has it; rows (size,): whitened, measured minus model."""
    out = []
    for r in (r for r in problem.rows if r.channel == channel and np.any(r.bins > 0)):
        run = problem.runs[r.run]
        n, energy = run.t.size, float(np.sum(run.taper**2))
        lines = np.zeros(n // 2 + 1, complex)
        part = rows[r.start : r.start + r.size]
        lines[r.bins] = part[: r.bins.size] + 1j * part[r.bins.size :]
        lines[0] = 0.0  # the mean has another accuracy than the noise, see `steady`
        inside = r.bins > 0
        noise = 4 * inside.sum() / n * run.taper**2 / energy
        w = 2 * np.pi * np.arange(n // 2 + 1) * RATE / n
        low, high = float(w[r.bins[inside][0]]), float(w[r.bins[-1]])
        x = np.fft.irfft(lines, n)
        out.append(Residual(run, r.channel, x, noise, 4 / (RATE * energy), low, high))
    return out


def spectrum(problem: Problem, rows: Array, channel: str, run: int | None = None) -> tuple[Array, Array]:
    """(mean square (k,), number (k,)) of the rows between the `EDGES` (k+1,)."""
    total, count = np.zeros(EDGES.size - 1), np.zeros(EDGES.size - 1)
    for r in problem.rows:
        if r.channel != channel or run not in (None, r.run):
            continue
        part = rows[r.start : r.start + r.size]
        k = np.searchsorted(EDGES, 2 * np.pi * r.f, "right") - 1
        inside = (k >= 0) & (k < total.size) & (r.f > 0)
        squares = part[: r.bins.size] ** 2 + part[r.bins.size :] ** 2
        np.add.at(total, k[inside], squares[inside])
        np.add.at(count, k[inside], 2.0)
    return total / np.maximum(count, 1.0), count


def floor_error(problem: Problem) -> Array:
    """Relative standard deviation (k,) of the noise floor between the `EDGES` (k+1,).

    Overlap of the frames increases it, smoothing over frequencies reduces it. Measured on white noise, its
    square is 1.4/(number of frames) where frames are fewest, elsewhere 0.9/(number).
    """
    f, frames = quiet_frames(problem.runs)
    middle = np.sqrt(EDGES[1:] * EDGES[:-1]) / (2 * np.pi)
    return np.sqrt(1.4 / np.maximum(np.interp(middle, f, frames), 1.0))


def above_noise(power: float, count: float, floor: float) -> bool:
    """True where a mean square over `count` rows is large and significantly above the noise, 1.

    floor: relative standard deviation of the noise floor. The test is an F test, since both are estimates.
    """
    chance = fdtrc(max(count, 1.0), 2.0 / max(floor, 1e-3) ** 2, power)
    return bool(power > LARGE**2 and chance < ndtr(-SIGMAS))


def rms_over_noise(power: Array, count: Array, chosen: Any) -> float:
    """Root of the mean of the chosen powers (k,) over noise, each of `count` (k,) rows."""
    return float(np.sqrt(np.sum((power * count)[chosen]) / np.sum(count[chosen])))


@dataclass(frozen=True, eq=False)
class SignalFit:
    """Least squares of a channel's residual on k signals.

    amounts (k,) and their standard deviations errors (k,). sizes (k,): signed rms over noise of each signal
    in its rows. drop: of the sum of squares, over the rows' variance. ratio: rms over noise in those rows.
    """

    amounts: Array
    errors: Array
    sizes: Array
    drop: float
    ratio: float


Signals = Callable[[Experiment], Mapping[str, Array]]


def fit_signals(
    problem: Problem, rows: Array, channel: str, nuisances: Signals, added: Signals, run: int | None = None
) -> SignalFit | None:
    """Least squares of the channel's rows on signals {name: (n,)} of each run; None where they are zero.

    nuisances: signals fitted too, but not counted; added: the signals of interest. run: only this one.
    """
    target = problem.part(rows, run, channel)
    base, more = (_columns(problem, channel, s, run) for s in (nuisances, added))
    q, _ = np.linalg.qr(base)
    remaining, own = target - q @ (q.T @ target), more - q @ (q.T @ more)
    gram = own.T @ own
    if np.any(np.diag(gram) < 1e-6 * np.maximum(np.sum(more**2, axis=0), 1e-12)):
        return None
    amounts = np.asarray(np.linalg.solve(gram, own.T @ remaining), float)
    drop = float(remaining @ (own @ amounts))
    spread = max(
        1.0, float(remaining @ remaining - drop) / max(target.size - base.shape[1] - more.shape[1], 1)
    )
    power = np.sum(own**2, axis=1)
    count = float(np.sum(power) ** 2 / np.sum(power**2))
    errors: Array = np.sqrt(np.diag(np.linalg.inv(gram)) * spread)
    sizes = amounts * np.sqrt(np.sum(more**4, axis=0) / np.sum(more**2, axis=0))
    return SignalFit(amounts, errors, sizes, drop / spread, float(np.sqrt(1.0 + drop / count)))


def _columns(problem: Problem, channel: str, signals: Signals, only: int | None) -> Array:
    """Rows (m, k) of signals, whitened like the channel's residual."""
    parts = []
    for r in problem.rows:
        if r.channel == channel and only in (None, r.run):
            run = problem.runs[r.run]
            lines = [np.fft.rfft(y * run.taper)[r.bins] * r.weight for y in signals(run).values()]
            parts.append(np.column_stack([np.concatenate((x.real, x.imag)) for x in lines]))
    return np.concatenate(parts)


def channel_name(channel: str) -> str:
    """A channel's name in a sentence."""
    return {"ay": "a_y", "vy": "V_y"}.get(channel, channel)


def rounded_band(low: float, high: float) -> tuple[float, float]:
    """A band [rad/s] with two digits."""
    return float(f"{low:.2g}"), float(f"{high:.2g}")


def noise_ratio(ratio: float) -> str:
    """A size in multiples of the noise."""
    return f"{ratio:.0f} times the noise" if ratio >= 10 else f"{ratio:.1f} times the noise"


def ordinal(k: int) -> str:
    """1st, 2nd, 3rd, 4th ..."""
    return str(k) + {1: "st", 2: "nd", 3: "rd"}.get(k, "th")


# Location by turn, heading and steady error: the residual is regressed on signals of each.


WINDS = ("north", "north-west", "west", "south-west", "south", "south-east", "east", "north-east")
COMPASS = ("N", "NE", "E", "SE", "S", "SW", "W", "NW")
SLOW = 1.0  # rad/s, highest frequency in the picture over headings


def steady(problem: Problem, rows: Array, channel: str) -> Iterator[Mismatch]:
    """A mean residual with the same sign in all runs, over the accuracy of a run's mean (`MEANS`)."""
    if channel not in MEANS:
        return
    having = [r for r in problem.rows if r.channel == channel and r.bins[0] == 0]
    off = np.array([rows[r.start] for r in having])
    ratio = float(np.sqrt(np.mean(off**2))) if off.size else 0.0
    if not off.size or ratio < max(LARGE, SIGMAS / np.sqrt(off.size)) or abs(np.sum(np.sign(off))) < off.size:
        return
    factor, unit = (180 / np.pi, "deg/s") if channel == "r" else (1.0, "m/s²")
    mean = factor * MEANS[channel] * off
    side = "left" if off[0] > 0 else "right"
    low, high = sorted((float(np.min(np.abs(mean))), float(np.max(np.abs(mean)))))
    size = f"{high:.2g}" if low > 0.9 * high else f"{low:.2g} to {high:.2g}"
    sentence = (
        f"{channel_name(channel)} is steadily {size} {unit} further to the {side} than simulated, "
        f"{ratio:.1f} times the accuracy of a run's mean"
    )
    names = tuple(problem.runs[r.run].name for r in having)
    profile = Profile("run", "", names, tuple(float(abs(v)) for v in off))
    yield Mismatch(channel, (0.0, 0.0), "steady", ratio, sentence, profile)


def by_turn(problem: Problem, rows: Array, channel: str) -> Iterator[Mismatch]:
    """Left and right turns with the residual a different share of the motion in each."""

    def sides(run: Experiment) -> dict[str, Array]:
        turn = _turn(run)
        y = run.measured[channel]
        return {"left": y * (turn > 0), "right": y * (turn <= 0)}

    def both(run: Experiment) -> dict[str, Array]:
        y = run.measured[channel]
        return {"rest": np.ones(y.size), "motion": y, "rate": np.gradient(y, 1 / RATE)}

    def difference(run: Experiment) -> dict[str, Array]:
        return {"difference": run.measured[channel] * np.sign(_turn(run))}

    def constant(run: Experiment) -> dict[str, Array]:
        return {"rest": np.ones(run.t.size)}

    if any("r" not in run.measured for run in problem.runs):
        return
    found = fit_signals(problem, rows, channel, both, difference)
    if found is None or found.drop < SIGMAS**2 or found.ratio < LARGE:
        return
    apart = fit_signals(problem, rows, channel, constant, sides)
    if apart is None or abs(apart.amounts[0] - apart.amounts[1]) < SIGMAS * np.hypot(*apart.errors):
        return
    left, right = (100 * float(v) for v in apart.amounts)
    words = ", ".join(
        f"{abs(v):.1f} % {'more' if v > 0 else 'less'} than simulated in {side} turns"
        for side, v in (("left", left), ("right", right))
    )
    size = noise_ratio(found.ratio)
    sentence = f"{channel_name(channel)} differs between left and right turns by {size}: {words}"
    where = "left turns" if abs(left) > abs(right) else "right turns"
    profile = Profile("turn", "", ("left", "right"), (float(apart.sizes[0]), float(apart.sizes[1])))
    top = max(float(r.f[-1]) for r in problem.rows if r.channel == channel)
    yield Mismatch(channel, (0.0, round(2 * np.pi * top, 1)), where, found.ratio, sentence, profile)


def _turn(run: Experiment) -> Array:
    return run.measured["r"] - run.at_rest.get("r", 0.0)


def by_heading(problem: Problem, rows: Array, channel: str) -> Iterator[Mismatch]:
    """A residual in proportion to the cosine and sine of the heading, as on a slope.

    Signals of the motion are fitted too, so that only the rest counts.
    """
    if not all(run.has_heading and "r" in run.measured for run in problem.runs):
        return
    if np.ptp(np.concatenate([run.heading for run in problem.runs])) < np.pi / 2:
        return

    def heading(run: Experiment) -> dict[str, Array]:
        return {"cos": np.cos(run.heading), "sin": np.sin(run.heading)}

    found = fit_signals(problem, rows, channel, _of_the_motion, heading)
    # a drop by two signals that is as rare as `SIGMAS` on both sides
    if found is None or found.drop < -2 * np.log(2 * ndtr(-SIGMAS)) or found.ratio < LARGE:
        return
    agree = []  # of all runs with enough headings, at least two
    for k, run in enumerate(problem.runs):
        alone = fit_signals(problem, rows, channel, _of_the_motion, heading, k)
        if alone is not None and np.ptp(run.heading) >= np.pi / 2:
            off, near = np.abs(alone.amounts - found.amounts), 0.5 * np.hypot(*found.amounts)
            agree.append(bool(np.all(off < np.maximum(near, SIGMAS * alone.errors))))
    if len(agree) < 2 or not all(agree):
        return
    across = WINDS[int(np.round(np.arctan2(found.amounts[1], found.amounts[0]) / (np.pi / 4))) % 8]
    sentence = (
        f"{channel_name(channel)} differs with the heading by {noise_ratio(found.ratio)}: most to the left "
        f"when the rover heads {across}, and to the right in the opposite direction"
    )
    # the fitted part over noise, left positive, for eight headings clockwise from N; 0 where not driven
    driven = np.round(np.concatenate([run.heading for run in problem.runs]) / (np.pi / 4)).astype(int) % 8
    turned = -np.arange(8) * np.pi / 4  # the heading is left positive
    part = np.array([np.cos(turned), np.sin(turned)]).T @ (found.amounts / np.hypot(*found.amounts))
    ratio = np.where(np.isin(-np.arange(8) % 8, driven), found.ratio * part, 0.0)
    profile = Profile("heading", "", COMPASS, tuple(map(float, ratio)))
    yield Mismatch(channel, (0.0, SLOW), f"heading {across}", found.ratio, sentence, profile)


def _of_the_motion(run: Experiment) -> dict[str, Array]:
    """Signals that resemble the heading in a slow sweep: yaw rate, its rate, its integral, and functions."""
    turn = _turn(run)
    rate = np.gradient(turn, 1 / RATE)
    turn, rate = (x / max(float(np.std(x)), 1e-9) for x in (turn, rate))
    return {
        "rest": np.ones(turn.size),
        "turn": turn,
        "rate": rate,
        "integral": run.heading - np.mean(run.heading),
        "turn^3": turn**3,
        "turn^2 rate": turn**2 * rate,
        "turn rate^2": turn * rate**2,
        "rate^3": rate**3,
        "abs turn": np.abs(turn),
        "abs rate": np.abs(rate),
        "side": np.tanh(10.0 * turn),
        "way": np.tanh(10.0 * rate),
    }


# Location by the cycles of a sweep's steering: harmonics, and the part of a run that differs from others.
#
# Order analysis: the residual is resampled over the phase of the steering instead of time. What is caused at
# the k-th harmonic of the steering frequency is then at order k, at any sweep rate. Windows of four cycles
# resolve quarters of an order.


CYCLES = 4  # of a window, and the fewest of a part of a run


def begins_of_cycles(run: Experiment) -> Array:
    """Times (n + 1,) [s] at which the n whole cycles of a sweep's steering begin, and the last one ends.

    Between upward zero crossings; parts with less than half of the amplitude are left out.
    """
    x = run.steer - np.median(run.steer)
    k = np.flatnonzero((x[:-1] <= 0) & (x[1:] > 0))
    t = run.t[k] - x[k] * (run.t[k + 1] - run.t[k]) / (x[k + 1] - x[k])
    swing = [np.max(np.abs(x[a : b + 1])) for a, b in zip(k[:-1], k[1:], strict=True)]
    whole = np.flatnonzero(np.array(swing) > 0.5 * run.amplitude)
    return np.asarray(t[whole[0] : whole[-1] + 2] if whole.size else t[:0])


def by_order(problem: Problem, rows: Array, channel: str) -> Iterator[Mismatch]:
    """Harmonics of the sweeps (second and up) that exceed their background half an order away."""
    size = CYCLES * (HARMONICS + 1)
    power, count, low, high = np.zeros(size), np.zeros(size), np.full(size, np.inf), np.zeros(size)
    for e in residuals_of(problem, rows, channel):
        for w, power_of_window in _windows(e, size) if e.run.kind in ("sweep", "bias_sweep") else ():
            at = np.arange(size) * w / CYCLES
            inside = (at >= e.low) & (at <= e.high)
            power[inside] += power_of_window[inside]
            count[inside] += 1.0  # Hann windows that overlap by half are nearly independent
            low[inside], high[inside] = np.minimum(low, at)[inside], np.maximum(high, at)[inside]
    power /= np.maximum(count, 1.0)
    orders = [k for k in range(1, HARMONICS + 1) if count[CYCLES * k] > 0]
    sizes = tuple(float(np.sqrt(power[CYCLES * k])) for k in orders)
    profile = Profile("harmonic", "", tuple(map(float, orders)), sizes)
    for k in orders[1:]:
        peak, words = CYCLES * k, f"{ordinal(k)} harmonic"
        near = [j for j in (peak - CYCLES // 2, peak + CYCLES // 2) if j < size and count[j] > 0]
        background = max(1.0, *(float(power[j]) for j in near))
        sure = (power[peak] / background - 1) * np.sqrt(count[peak]) > SIGMAS
        if sure and power[peak] > max(LARGE**2 * background, 0.01 * power[CYCLES]):
            ratio = float(np.sqrt(power[peak]))
            sentence = (
                f"{channel_name(channel)} differs by {noise_ratio(ratio)} at the {words} of the steering "
                f"frequency and by {np.sqrt(background):.1f} next to it"
            )
            yield Mismatch(channel, rounded_band(low[peak], high[peak]), words, ratio, sentence, profile)


def _windows(e: Residual, size: int) -> Iterator[tuple[float, Array]]:
    """(steering frequency [rad/s], power over noise at quarter orders (size,)) of windows of four cycles."""
    begins, points = begins_of_cycles(e.run), 64  # of a cycle
    n = CYCLES * points
    window = np.hanning(n + 1)[:n]
    for k in range(0, begins.size - CYCLES, CYCLES // 2):
        t = np.interp(np.arange(n) / points, np.arange(CYCLES + 1), begins[k : k + CYCLES + 1])
        w = 2 * np.pi * CYCLES / (t[-1] - t[0]) * (n - 1) / n
        lines = np.abs(np.fft.rfft(np.interp(t, e.run.t, e.x) * window)[:size]) ** 2
        # noise of the one-sided density S has the power S/2 times the rate of the grid
        yield float(w), lines / (e.density / 2 * points * w / (2 * np.pi) * np.sum(window**2))


@dataclass(frozen=True, eq=False)
class _History:
    """The n cycles of a sweep: begins t (n + 1,) [s], frequency w (n,) [rad/s], power over noise (n,).

    count (n,): independent numbers in each cycle; a band of B rad/s over T s holds B T / pi of them.
    """

    residual: Residual
    t: Array
    w: Array
    power: Array
    count: Array

    @staticmethod
    def of(e: Residual) -> _History:
        t = begins_of_cycles(e.run)
        k = np.searchsorted(e.run.t, t)
        energy, noise = (np.concatenate(([0.0], np.cumsum(x))) for x in (e.x**2, e.noise))
        power = np.diff(energy[k]) / np.maximum(np.diff(noise[k]), 1e-12)
        count = np.maximum((e.high - e.low) / np.pi * np.diff(t), 1.0)
        return _History(e, t, 2 * np.pi / np.diff(t), power, count)

    def expected(self, others: list[_History]) -> Array:
        """Power (n,) of each cycle by other runs, in proportion to the steering amplitude."""
        found = []
        for o in others:
            grown = (self.residual.run.amplitude / o.residual.run.amplitude) ** 2
            order = np.argsort(o.w)
            above = np.maximum(o.power - 1.0, 0.0)[order]
            found.append(1.0 + grown * np.interp(np.log(self.w), np.log(o.w[order]), above))
        return np.asarray(np.mean(found, axis=0))


def by_time(problem: Problem, rows: Array, channel: str) -> Iterator[Mismatch]:
    """Parts of a run that differ from other runs at the same speed and frequencies."""
    sweeps = [_History.of(e) for e in residuals_of(problem, rows, channel) if e.run.kind == "sweep"]
    histories = [h for h in sweeps if h.power.size > 2 * CYCLES]
    for h in histories:
        others = [o for o in histories if o is not h and same_speed(o.residual.run, h.residual.run)]
        if others:
            yield from _part(h, np.log(np.maximum(h.power, 0.1) / h.expected(others)))


def _part(h: _History, excess: Array) -> Iterator[Mismatch]:
    """The part with the largest mean excess (n,) over the rest; excess: ln of power over expected one."""
    n, e = excess.size, h.residual
    total = np.concatenate(([0.0], np.cumsum(excess - excess.mean())))
    spans = ((i, j) for i in range(n) for j in range(i + CYCLES, min(n, n + i - CYCLES) + 1))
    a, b = max(spans, key=lambda s: (total[s[1]] - total[s[0]]) / np.sqrt((s[1] - s[0]) * (n - s[1] + s[0])))
    inside = (np.arange(n) >= a) & (np.arange(n) < b)
    apart = float(np.mean(excess[inside]) - np.mean(excess[~inside]))
    spread = float(np.hypot(np.std(excess[inside]), np.std(excess[~inside])))
    error = spread * np.sqrt(2.0 / inside.sum() + 2.0 / (~inside).sum())  # neighbours are correlated
    here, there = (rms_over_noise(h.power, h.count, m) for m in (inside, ~inside))
    if apart < max(np.log(4.0), SIGMAS * error) or here < LARGE * max(1.0, there):  # at least twice the rms
        return
    first, last = float(h.t[a]), float(h.t[b])
    when = f"until {last:.0f} s" if a == 0 else f"between {first:.0f} and {last:.0f} s"
    when = f"from {first:.0f} s on" if b == n else when
    sentence = (
        f"{channel_name(e.channel)} differs {when} in {e.run.name} by {noise_ratio(here)} ({there:.1f} in "
        "the rest of the run); other runs at this speed do not show it at the same frequency"
    )
    middle = tuple(map(float, 0.5 * (h.t[1:] + h.t[:-1])))
    profile = Profile("time", "s", middle, tuple(map(float, np.sqrt(h.power))))
    band = rounded_band(h.w[a:b].min(), h.w[a:b].max())
    yield Mismatch(e.channel, band, f"{e.run.name} {when}", here, sentence, profile)
