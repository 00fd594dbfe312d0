"""The noise floor of a recording, measured at the frequencies that the steering does not excite.

A sweep excites one frequency at a time; at all others except its multiples, the residual is noise. The
estimate Gyy (1 - coherence) would contain the distortion that the diagnosis looks for.

1. The residual is cut into frames of `WINDOW`, one second apart. Mean and slope are taken out and a Hann
   window w is applied (Welch 1967). One-sided density of a line X_k: 2 |X_k|^2 / (rate sum w^2).
2. Taking out mean and slope, the orthonormal vectors u_1, u_2, also takes noise. Of white noise the line k
   keeps the share 1 - sum_i |FFT(w u_i)_k|^2 / sum w^2, by which the density is divided (exact, since the
   removal is a projection).
3. A line counts as excited where the steering's amplitude there is above `EXCITED` of its largest. It, its
   multiples up to `HARMONICS`, the mean, and `GUARD` Hz on either side are left out.
4. The density at a frequency is the mean of the remaining frames of all runs, at least four; where fewer
   remain it is interpolated in log density. Five lines with weights 1 2 3 2 1 smooth the result.
5. No density is below that of the best sensor (`LEAST`): a simulator's log has hardly any noise, and model
   errors below sensor noise do not count.

A mean over m independent frames has the relative standard deviation 1/sqrt(m) (Bendat and Piersol 2010,
chapter 8); `locate.residual_maps.floor_error` has the value measured for these overlapping frames.

Runs by hand, smoothed or resampled, whose sensors' low-passes are not known (tables): driving by hand excites
every low frequency in every frame, so no line is quiet, and the few quiet lines lie where smoothing took the
noise away. There the floor would be near zero, and everything significant. So:

1. Where a line is never quiet, noise is all that neighbouring lines do not share: over 2 n + 1 lines of a
   run, a smooth response to the steering and a smooth transient are fitted to the residual (local polynomial
   method, Pintelon and Schoukens 2012, chapter 7), or the frames of all runs, five or more, share one
   response. The rest is noise and scatter from nonlinear laws; both estimates tend to be too large, so the
   smaller one counts.
2. Above `BAND` the floor is at least `KEPT` of its median within that band: smoothing takes the noise away,
   but a model does not become more accurate there.
3. The signal resolves nothing above the frequency at which its own density falls below `COLLAPSED` of that
   median. Lines beyond are not used.

Welch 1967: The use of fast Fourier transform for the estimation of power spectra, IEEE Trans. AU-15(2).
Bendat and Piersol 2010: Random Data, 4th edition, Wiley.
Pintelon and Schoukens 2012: System Identification, a frequency domain approach, 2nd edition, Wiley.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.simulation.experiment import RATE, Experiment

WINDOW = 4.0  # s
REPEATS = 5  # trials from which short ones together give a floor
HARMONICS = 5
GUARD = 0.6  # Hz, reach of a line to either side: a Hann window of 4 s, and the sweep moves
TOP = 12.0  # Hz, highest line that is compared with a model
EXCITED = 0.04  # of the largest steering amplitude
BAND = (1.0, 4.0)  # Hz, above most driving and below any smoothing
KEPT, COLLAPSED = 0.25, 0.1  # of the median density within `BAND`
# One-sided densities below which no rover measures: .006 deg/s and 150 ug per sqrt(Hz), as the data sheet of
# the ICM-20689 has them, and 1 mm/s per sqrt(Hz) of V_y.
LEAST = {"r": 1.0e-8, "p": 1.0e-8, "ay": 2.2e-6, "vy": 1.0e-6}


@dataclass(frozen=True, eq=False)
class Floor:
    """One-sided noise density per channel: f (k,) Hz, density {channel: (k,)} unit^2/Hz.

    top: {channel: highest frequency that it resolves [Hz]}, where smoothing or resampling limits it.
    """

    f: Array
    density: Mapping[str, Array]
    top: Mapping[str, float] = field(default_factory=dict)

    def at(self, channel: str, f: Array) -> Array:
        """Density (n,) at f (n,) [Hz], log-linear between the estimates, flat above them.

        Below the lowest frequency that a frame resolves it grows as 1/f^2, as camber, gusts and drift do.
        """
        inside = np.exp(np.interp(f, self.f, np.log(self.density[channel])))
        lowest = self.f[0]
        return np.where(f < lowest, inside * (lowest / np.maximum(f, 0.05 * lowest)) ** 2, inside)

    def times(self, levels: Mapping[str, float]) -> Floor:
        """The floor with the density of each channel times its level (default 1)."""
        return replace(self, density={c: d * levels.get(c, 1.0) for c, d in self.density.items()})

    def rms(self, channel: str, low: float, high: float) -> float:
        """RMS of the noise between two frequencies [Hz], in the channel's SI unit."""
        f = np.linspace(low, high, 60)
        return float(np.sqrt(np.trapezoid(self.at(channel, f), f)))


def floor_of(runs: Sequence[Experiment], residuals: Sequence[Mapping[str, Array]]) -> Floor:
    """The floor pooled over runs, from the residuals {channel: (n,)} of each, in SI units."""
    size = frame_size(runs)
    f: Array = np.asarray(np.fft.rfftfreq(size, 1 / RATE), np.float64)
    channels = sorted({c for r in residuals for c in r})
    quiet = [_quiet(run, f, size) for run in runs]
    density: dict[str, Array] = {}
    top: dict[str, float] = {}
    for channel in channels:
        own = [
            (run, mask, found[channel])
            for run, mask, found in zip(runs, quiet, residuals, strict=True)
            if channel in found
        ]
        power = np.concatenate([np.where(mask, _power(x, size), np.nan) for _, mask, x in own])
        if not is_table(runs):
            density[channel] = _pooled(power, f)
            continue
        drive = np.concatenate([_lines(run.steer * run.speed, size) for run, _, _ in own])
        rest = np.concatenate([_lines(x, size) for _, _, x in own])
        averages = sum(max(run.t.size / size, 1.0) for run, _, _ in own if run.t.size >= size)
        local = np.fmin(
            pooled_local([run for run, _, _ in own], [x for _, _, x in own], f[1:]),
            incoherent_density(drive, rest, averages)[1:],
        )
        density[channel] = bounded(f[1:], _pooled(power, f, local))
        measured = np.concatenate([_power(run.measured[channel], size) for run, _, _ in own]).mean(axis=0)
        limit = resolved_top(f[1:], measured[1:], band_level(f[1:], density[channel]))
        top |= {channel: limit} if np.isfinite(limit) else {}
    density = {c: np.maximum(d, LEAST.get(c, 0.0)) for c, d in density.items()}
    return Floor(f[1:], density, top)


def frame_size(runs: Sequence[Experiment]) -> int:
    """Samples of a frame: `WINDOW`, or the shortest of `REPEATS` short trials."""
    lengths = [run.t.size for run in runs]
    if max(lengths) >= WINDOW * RATE or len(runs) < REPEATS:
        return int(WINDOW * RATE)
    return min(n for n in lengths if n >= min(1.5 * RATE, max(lengths)))


def has_floor(runs: Sequence[Experiment]) -> bool:
    """True if a noise floor can be found, from quiet lines, or in a table from neighbouring lines."""
    long = max(run.t.size for run in runs) >= 2 * WINDOW * RATE
    if is_table(runs) and (long or len(runs) >= REPEATS):
        return True
    return bool(np.any(quiet_frames(runs)[1]))


def smoothed_channels(floor: Floor) -> list[str]:
    """A sentence for each channel that lost high frequencies by smoothing or resampling."""
    return [
        f"{channel} was smoothed or resampled: its spectrum collapses above {top:.2g} Hz (not used)"
        for channel, top in floor.top.items()
    ]


def quiet_frames(runs: Sequence[Experiment]) -> tuple[Array, Array]:
    """(f (k,) Hz, number (k,) of frames of all runs that are not excited at that frequency)."""
    size = frame_size(runs)
    f: Array = np.asarray(np.fft.rfftfreq(size, 1 / RATE), np.float64)
    count = np.sum([np.sum(_quiet(run, f, size), axis=0) for run in runs], axis=0)
    return f[1:], np.asarray(count[1:], np.float64)


def level_of(run: Experiment, residual: Mapping[str, Array], floor: Floor) -> dict[str, float]:
    """{channel: noise power of one run over the floor's}.

    residual {channel: (n,)}: of a model that fits. Mean over the quiet lines from 1 Hz (removing mean and
    slope costs power below) to `TOP` (filters leave less than the least floor above); 1 for fewer than 100
    lines.
    """
    size = frame_size([run])
    f: Array = np.asarray(np.fft.rfftfreq(size, 1 / RATE), np.float64)
    out = {}
    for channel, x in residual.items():
        highest = min(TOP, 0.4 * run.rates.get(channel, RATE))
        quiet = _quiet(run, f, size) & (f >= 1.0) & (f <= highest)
        ratio = _power(x, size)[:, 1:] / floor.at(channel, f[1:])
        out[channel] = float(np.mean(ratio[quiet[:, 1:]])) if quiet.sum() >= 100 else 1.0
    return out


def _frames(x: Array, size: int) -> Array:
    """Overlapping frames (m, size) of x, a second apart."""
    starts = np.arange(0, max(x.size - size, 0) + 1, int(RATE))
    return np.stack([x[s : s + size] for s in starts]) if x.size >= size else np.zeros((0, size))


def _power(x: Array, size: int) -> Array:
    """One-sided density (m, k) of each frame, unit^2/Hz."""
    return np.asarray(np.abs(_lines(x, size)) ** 2)


def _lines(x: Array, size: int) -> NDArray[np.complex128]:
    """Lines (m, k) of each frame, whose squares are its one-sided density in unit^2/Hz."""
    frames = _frames(x, size)
    k = np.arange(size) - 0.5 * (size - 1)
    slope = (frames @ k) / (k @ k)
    window = 0.5 - 0.5 * np.cos(2 * np.pi * (np.arange(size) + 0.5) / size)
    flat = frames - frames.mean(axis=1, keepdims=True) - slope[:, None] * k
    scale = np.sqrt(2 / (RATE * np.sum(window**2)) / _retained(size))
    return np.asarray(np.fft.rfft(flat * window, axis=1) * scale)


@cache
def _retained(size: int) -> Array:
    """Share (k,) of white noise that a line keeps when mean and slope are removed from its frame."""
    k = np.arange(size) - 0.5 * (size - 1)
    window = 0.5 - 0.5 * np.cos(2 * np.pi * (np.arange(size) + 0.5) / size)
    taken = [np.abs(np.fft.rfft(window * u / np.linalg.norm(u))) ** 2 for u in (np.ones(size), k)]
    retained = np.maximum(1.0 - (taken[0] + taken[1]) / np.sum(window**2), 0.05)
    return np.asarray(retained, np.float64)


def _quiet(run: Experiment, f: Array, size: int) -> NDArray[np.bool_]:
    """(m, k) True if the run excites neither that frequency nor a subharmonic of it."""
    frames = _frames(run.steer, size)
    flat = frames - frames.mean(axis=1, keepdims=True)
    window = np.hanning(size)
    lines = np.abs(np.fft.rfft(flat * window, axis=1)) / (0.25 * size)
    excited = lines > EXCITED * run.amplitude
    reach = int(np.ceil(max(GUARD, 2.4 * f[1]) / f[1] - 1e-9))
    quiet = np.ones_like(excited)
    for row in range(excited.shape[0]):
        for k in np.flatnonzero(excited[row]):
            for multiple in range(HARMONICS + 1):
                quiet[row, max(multiple * k - reach, 0) : multiple * k + reach + 1] = False
    return quiet


def _pooled(power: Array, f: Array, local: Array | None = None) -> Array:
    """Mean density (k-1,) of the quiet frames if there are four or more, else from neighbours.

    local (k-1,): density to take instead of the neighbours', for lines that are never quiet.
    """
    count = np.sum(~np.isnan(power), axis=0)
    with np.errstate(invalid="ignore"):
        mean = np.where(count >= 4, np.nansum(power, axis=0) / np.maximum(count, 1), np.nan)
    if local is not None:
        mean[1:] = np.where(np.isnan(mean[1:]), local, mean[1:])
    known = np.flatnonzero(~np.isnan(mean[1:])) + 1
    if known.size < 3:
        mean = np.nanmin(np.where(np.isnan(power), np.inf, power), axis=0)
        known = np.flatnonzero(np.isfinite(mean[1:])) + 1
    logs = np.interp(np.arange(1, f.size), known, np.log(np.maximum(mean[known], 1e-30)))
    kernel = np.array([1.0, 2.0, 3.0, 2.0, 1.0]) / 9.0
    return np.exp(np.convolve(np.pad(logs, 2, mode="edge"), kernel, mode="valid"))


def is_table(runs: Sequence[Experiment]) -> bool:
    """True if no low-pass is known: runs not from an autopilot, perhaps smoothed."""
    return not any(run.filters for run in runs)


def local_density(run: Experiment, residual: Array) -> tuple[Array, Array]:
    """(f (k,) Hz, one-sided density (k,) unit^2/Hz): what near lines of a residual (n,) do not share."""
    reach, degree = (6, 2) if run.t.size > 10.0 * RATE else (4, 1)  # lines on each side, of the polynomials
    lines = int(min((TOP + 2.0) * run.t.size / RATE, run.t.size // 2))
    drive, out = (np.fft.rfft(x)[1 : lines + 1] for x in (run.steer * run.speed, residual))
    centres = np.arange(reach, lines - reach, max(reach // 2, 1))
    if centres.size == 0:
        return np.empty(0), np.empty(0)
    near = np.arange(-reach, reach + 1)
    powers = (near / reach)[:, None] ** np.arange(degree + 1)[None, :]
    u, y = drive[centres[:, None] + near], out[centres[:, None] + near]
    scale = np.maximum(np.max(np.abs(u), axis=1, keepdims=True), 1e-30)
    transient = np.broadcast_to(powers + 0j, (*u.shape, powers.shape[1]))
    k = np.concatenate(((u / scale)[:, :, None] * powers, transient), axis=2)
    rest = y - np.einsum("mij,mj->mi", k, np.einsum("mji,mi->mj", np.linalg.pinv(k), y))
    power = np.sum(np.abs(rest) ** 2, axis=1) / (2 * reach + 1 - 2 * (degree + 1))
    return (centres + 1) * RATE / run.t.size, power * 2 / (RATE * run.t.size)


def pooled_local(runs: Sequence[Experiment], residuals: Sequence[Array], f: Array) -> Array:
    """The mean density (k,) of several runs at f (k,) [Hz]; NaN where no run has lines."""
    pairs = [local_density(run, x) for run, x in zip(runs, residuals, strict=True)]
    found = [(at, density) for at, density in pairs if at.size]
    if not found:
        return np.full(f.size, np.nan)
    parts = [np.interp(f, at, d) for at, d in found]
    weights = np.array([at.size for at, _ in found], float)
    return np.asarray(np.average(parts, axis=0, weights=weights))


def incoherent_density(drive: NDArray[np.complex128], out: NDArray[np.complex128], averages: float) -> Array:
    """Density (k,) of the lines `out` (m, k) not explained by a common response to `drive`, NaN if few.

    averages: independent frames, of the m that overlap.
    """
    if averages < 5.0:
        return np.full(out.shape[1], np.nan)
    response = np.sum(np.conj(drive) * out, axis=0) / np.maximum(np.sum(np.abs(drive) ** 2, axis=0), 1e-30)
    rest = np.mean(np.abs(out - response * drive) ** 2, axis=0)
    return np.asarray(rest * averages / (averages - 1.0))


def bounded(f: Array, density: Array) -> Array:
    """The density (k,) at f (k,) [Hz]; above `BAND` at least `KEPT` of the median in it."""
    level = band_level(f, density)
    return np.where(f > BAND[1], np.maximum(density, KEPT * level), density)


def band_level(f: Array, density: Array) -> float:
    """Median density within `BAND`."""
    inside = (f >= BAND[0]) & (f <= BAND[1])
    return float(np.median(density[inside])) if inside.any() else 0.0


def resolved_top(f: Array, measured: Array, level: float) -> float:
    """The frequency [Hz] above which the measured density (k,) has collapsed; infinite where it has not.

    level: floor within `BAND`. Judged on means over 1 Hz, to ignore a single notch, and from 2 Hz on, to keep
    a yaw mode.
    """
    width = max(int(np.ceil(1.0 / f[0])) if f[0] > 0 else 1, 1)  # lines within 1 Hz
    smooth = np.convolve(np.pad(measured, width // 2, mode="edge"), np.full(width, 1.0 / width), mode="same")
    smooth = smooth[width // 2 : width // 2 + f.size]
    low = np.flatnonzero((smooth < COLLAPSED * level) & (f >= 2.0) & (f < TOP + 2.0))
    return float(f[low[0]]) if low.size else float("inf")
