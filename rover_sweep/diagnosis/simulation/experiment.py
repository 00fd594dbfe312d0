"""A run for the diagnosis: steering, speed, heading and measured channels on one time grid."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.fft import next_fast_len
from scipy.signal import lfilter, oaconvolve
from scipy.signal.windows import gaussian

from rover_sweep.data.recording import MOTIONS, Array, LowPass, Recording, Signal
from rover_sweep.errors import DataRefused

RATE = 100.0  # Hz, of the simulation; rows are compared up to 12 Hz
FINE = 2  # times as many points of the commanded steering, whose corners a rate limit or play shows
SLOWEST = 0.4  # m/s; a slip angle is not defined at standstill
SPEED_ERROR = 0.02  # m/s rms, of an EKF with a GPS; receivers specify 0.05 m/s before filtering
STEADIED = 4.0  # s, standard deviation of the Gaussian that takes the error out of a speed
DRIVE_LAGS = (0.2, 0.6, 2.0)  # s, in which a drive makes good a loss of speed: small and large rovers


@dataclass(frozen=True, eq=False)
class Experiment:
    """One run on a grid of `RATE` Hz, ISO axes, SI units.

    t (n,): time from the start of the grid [s]. steer (n,): commanded road-wheel angle [rad]. speed (n,):
    measured forward velocity, averaged over 0.25 s [m/s]. heading (n,): left positive [rad], zero if not
    recorded. measured: {channel: (n,)} of r, ay, p, vy. at_rest: {channel: mean at standstill}. filters:
    known low-passes. taper (n,): 0 at both ends, 1 between. rates: {channel: sampling rate [Hz]}.
    steer_rate: that of the steering [Hz]. begin: time of t = 0 on the clock of the recording [s].
    two_clocks: steering and motion come from different clocks. order: place among the runs in the order of
    driving; driven: time driven in the runs before [s]. commanded (FINE n,): `steer` on a finer grid, None
    where there is none. changes (n,): `unsure`, if already computed [m/s]. share: part of them in `speed`.
    angles: the last wheel angles, by their inputs (a cache).
    """

    name: str
    kind: str
    t: Array
    steer: Array
    speed: Array
    heading: Array
    measured: Mapping[str, Array]
    at_rest: Mapping[str, float]
    filters: Mapping[str, LowPass]
    taper: Array
    rates: Mapping[str, float] = field(default_factory=dict)
    has_heading: bool = False
    two_clocks: bool = False
    steer_rate: float = 0.0
    begin: float = 0.0
    order: int = 0
    driven: float = 0.0
    commanded: Array | None = None
    changes: Array | None = None
    share: float = 1.0
    angles: dict[Hashable, Array] = field(default_factory=dict, init=False, repr=False)

    @cached_property
    def fine_steer(self) -> Array:
        """Commanded road-wheel angle (FINE n,) rad at `FINE` times the rate."""
        if self.commanded is not None:
            return self.commanded
        fine = np.arange(FINE * self.t.size) / FINE
        return np.interp(fine, np.arange(self.t.size), self.steer)

    @cached_property
    def acceleration(self) -> Array:
        """Rate of change (n,) of the speed [m/s^2]."""
        return np.gradient(self.speed, 1.0 / RATE)

    @cached_property
    def unsure(self) -> Array:
        """Changes (n,) of the speed within `STEADIED` that may be an error of its estimate [m/s].

        Speed lost in turns is no error: it has twice the frequency of the steering, so a model without it
        would respond too early at the steering's own. Other changes count up to three times the usual error;
        power above that is no error.
        """
        if self.changes is not None:
            return self.changes
        changes = _quick(self.speed)
        rest = np.asarray(changes - self._lost_in_turns(changes))
        return np.asarray(rest * _may_be_error(rest))

    def _lost_in_turns(self, changes: Array) -> Array:
        """The part (n,) of the speed's changes that follows r d, the drag of turned wheels [m/s].

        The wheels' side force m_f r V slows the rover by its part along the body, sin d; the drive corrects
        the loss with a lag that is fitted. Fitted where the changes are small.
        """
        small = _may_be_error(changes) >= 1.0
        if "r" not in self.measured or np.count_nonzero(small) < RATE:
            return np.zeros_like(changes)
        drag = self.measured["r"] * self.steer
        keeps = [np.exp(-1.0 / (RATE * lag)) for lag in DRIVE_LAGS]
        lost = np.stack([_quick(lfilter([1.0 - k], [1.0, -k], drag)) for k in keeps], axis=1)
        return np.asarray(lost @ np.linalg.lstsq(lost[small], changes[small], rcond=None)[0])

    @cached_property
    def unsure_acceleration(self) -> Array:
        """Rate of change (n,) of `unsure` [m/s^2]."""
        return np.gradient(self.unsure, 1.0 / RATE)

    def steadied(self, share: float) -> Experiment:
        """The run without `unsure` in its speed, for derivatives of a model that includes this share of it.

        The measured speed multiplies both motion and derivatives. Their product has the square of its error,
        which does not average out and moves lag and inertia by 10 %.
        Fuller 1987: Measurement Error Models, section 2.4 (instrumental variables).
        """
        out = replace(self, speed=self.speed - self.unsure, changes=self.unsure, share=share)
        object.__setattr__(out, "angles", self.angles)  # of the wheels, for which the speed does not count
        return out

    @property
    def mean_speed(self) -> float:
        """Mean forward speed [m/s]."""
        return float(np.mean(self.speed))

    @property
    def amplitude(self) -> float:
        """Largest steering angle [rad]."""
        return float(np.max(np.abs(self.steer))) if self.steer.size else 0.0


def _quick(x: Array) -> Array:
    """The changes (n,) of x within `STEADIED`."""
    return np.asarray(x - _smooth(x, STEADIED))


def _smooth(x: Array, seconds: float) -> Array:
    """x (n,) smoothed by a Gaussian of this standard deviation; by FFT, since it has 3000 points."""
    reach = round(4 * seconds * RATE)
    weights = gaussian(2 * reach + 1, seconds * RATE)
    return np.asarray(oaconvolve(np.pad(x, reach, mode="edge"), weights / weights.sum(), mode="valid"))


def _may_be_error(changes: Array) -> Array:
    """Share (n,) of speed changes that is small enough for an error, within some seconds."""
    power = _smooth(changes**2, 1.0)
    return np.asarray(np.minimum(1.0, (3.0 * SPEED_ERROR) ** 2 / np.maximum(power, 1e-12)))


def experiment(run: Recording) -> Experiment:
    """The run with up to 1.5 s before and after its manoeuvre, while the rover was driving.

    DataRefused for a run in reverse.
    """
    if (driven := run.mean_speed) < 0:
        raise DataRefused(
            f"{run.name} was driven in reverse ({driven:.2f} m/s): only `rover-sweep identify` "
            "accepts such runs"
        )
    start, end = _driven(run)
    n = int((end - start) * RATE) + 1
    while n > 16 and next_fast_len(n, real=True) != n:  # for a fast Fourier transform
        n -= 1
    grid = start + np.arange(n) / RATE
    measured = {c: on_grid(run[c], grid) for c in MOTIONS if c in run}
    speed = smoothed(run["speed"].on(grid))
    heading = np.unwrap(run["psi"].on(grid)) if "psi" in run else np.zeros(grid.size)
    rest = {c: run.bias(c) for c in measured}
    return Experiment(
        run.name,
        run.kind,
        grid - grid[0],
        on_grid(run["delta"], grid),
        np.maximum(speed, _slowest(speed)),
        heading,
        measured,
        {c: b for c, b in rest.items() if b is not None},
        run.filters,
        tapered(grid.size),
        {c: run[c].rate for c in measured},
        "psi" in run,
        len({_clock(run, c) for c in ("delta", "r")}) > 1,
        run["delta"].rate,
        float(grid[0]),
        commanded=on_grid(run["delta"], grid[0] + np.arange(FINE * grid.size) / (FINE * RATE)),
    )


def in_order(runs: Sequence[Experiment]) -> list[Experiment]:
    """The same runs with `order` and `driven`: by their clock if it gives an order, else as given.

    Runs on one clock do not overlap; if they do (after a restart), the clock gives no order.
    """
    by_clock = sorted(runs, key=lambda r: r.begin)
    ends = [r.begin + float(r.t[-1]) for r in by_clock]
    one_clock = all(end <= after.begin for end, after in zip(ends, by_clock[1:], strict=False))
    ordered = by_clock if one_clock else list(runs)
    lengths = [float(r.t[-1]) for r in ordered]
    place = {id(r): (k, sum(lengths[:k])) for k, r in enumerate(ordered)}
    return [replace(r, order=place[id(r)][0], driven=place[id(r)][1]) for r in runs]


def _clock(run: Recording, channel: str) -> str:
    """The clock of a channel, by its message name: MAVLink names have an underscore or are ATTITUDE."""
    message = run[channel].source.partition(".")[0]
    return "tlog" if "_" in message or message == "ATTITUDE" else "vehicle"


def _driven(run: Recording) -> tuple[float, float]:
    """Begin and end [s] of the part that is used."""
    (start, end), speed, margin = run.span, run["speed"], 1.5
    slow = speed.t[speed.x < _slowest(run.manoeuvre("speed").x)]
    first = max((start - margin, float(speed.t[0]), *slow[slow < start][-1:].tolist()))
    last = min((end + margin, float(speed.t[-1]), *slow[slow > end][:1].tolist()))
    return min(first, start), max(last, end)


def _slowest(speed: Array) -> float:
    """Speed [m/s] below which the rover rests: `SLOWEST`, or half of a lower usual speed (n,)."""
    return min(SLOWEST, 0.5 * float(np.median(speed)))


def smoothed(x: Array) -> Array:
    """The mean (n,) of a speed (n,) over 0.25 s around each sample."""
    width = int(0.25 * RATE) | 1
    padded = np.pad(x, width // 2, mode="edge")
    return np.convolve(padded, np.full(width, 1.0 / width), mode="valid")


def tapered(n: int) -> Array:
    """Weight (n,): 1, with raised-cosine edges in the first and last second."""
    edge = min(int(RATE), n // 4)
    ramp = 0.5 - 0.5 * np.cos(np.pi * (np.arange(edge) + 0.5) / max(edge, 1))
    return np.concatenate((ramp, np.ones(n - 2 * edge), ramp[::-1]))


def on_grid(channel: Signal, grid: Array) -> Array:
    """Values (n,) of a channel at the times of an even `grid` (n,) [s].

    A cubic through the four nearest samples, since straight lines take 5 % of 10 Hz from samples at 100 Hz; a
    straight line where their intervals are not even. A staircase is averaged over the cells of the grid, and
    its loss at high frequencies is corrected: u - u'' step^2 / 24.
    """
    rough = channel.on(grid)
    if channel.hold:
        return rough - np.diff(np.pad(rough, 1, "edge"), 2) / 24.0
    t, x = channel.t, channel.x
    if t.size < 4:
        return rough
    k = np.clip(np.searchsorted(t, grid, "right") - 1, 1, t.size - 3)
    near = [t[k + j] for j in (-1, 0, 1, 2)]
    widest = np.max([b - a for a, b in zip(near, near[1:], strict=False)], axis=0)
    narrow = np.min([b - a for a, b in zip(near, near[1:], strict=False)], axis=0)
    usual = float(np.median(np.diff(t)))
    cubic = np.zeros(grid.size)
    with np.errstate(divide="ignore", invalid="ignore"):
        for j, own in enumerate(near):
            others = [other for i, other in enumerate(near) if i != j]
            weight = np.prod([(grid - o) / (own - o) for o in others], axis=0)
            cubic += weight * x[k + j - 1]
    inside = (grid >= t[0]) & (grid <= t[-1])
    smooth = inside & (widest <= 2.0 * usual) & (narrow >= usual / 4.0)
    return np.where(smooth, cubic, rough)
