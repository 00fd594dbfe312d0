"""Composite frequency responses out of several windows and runs, with coherence and random error.

Composite windowing as Tischler & Remple 2012, section 10.4, with the cross-spectrum's real and
imaginary parts normalised by its magnitude (the book divides by their own start values, which pass
through zero). The four unknowns of each frequency are solved at all frequencies at once.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rover_sweep.data.recording import Array, Recording, Signal
from rover_sweep.data.result_table import ShortTable, Shown, band_words
from rover_sweep.spectra.spectra import Complex, WindowSpectra, window_spectra

COHERENCE_GOOD = 0.6
Band = tuple[float, float]


@dataclass(frozen=True, eq=False, repr=False)
class FrequencyResponse(Shown):
    """Output over steering: h (n_w,) complex at w [rad/s] in output unit per input unit.

    coherence (n_w,), random_error (n_w,) normalised sd of |h|; windows: lengths used [s].
    gxx, gyy: composite autospectra. band: usable band (lo, hi) rad/s, None where there is none.
    conditioned_on: the inputs taken out of both, in which case coherence is the partial one;
    multiple_coherence: share of the output that follows all inputs; input_coherence: share of this input
    that follows the others; each (n_w,).
    """

    input: str
    output: str
    unit: str
    w: Array
    h: Complex
    coherence: Array
    random_error: Array
    gxx: Array
    gyy: Array
    windows: tuple[float, ...]
    band: Band | None
    conditioned_on: tuple[str, ...] = ()
    multiple_coherence: Array | None = None
    input_coherence: Array | None = None

    @property
    def magnitude_db(self) -> Array:
        """20 log10 |h|."""
        return 20 * np.log10(np.abs(self.h))

    @property
    def phase_deg(self) -> Array:
        """Phase, unwrapped upwards from the lowest frequency, deg."""
        return np.degrees(np.unwrap(np.angle(self.h)))

    def at(self, w: Array) -> tuple[Complex, Array]:
        """Response and coherence at w, interpolated over log w in dB and unwrapped phase."""
        x, grid = np.log(w), np.log(self.w)
        db, phase = np.interp(x, grid, self.magnitude_db), np.interp(x, grid, np.unwrap(np.angle(self.h)))
        return 10 ** (db / 20) * np.exp(1j * phase), np.interp(x, grid, self.coherence)

    def table(self) -> ShortTable:
        """Every so many frequencies, the usable band, the windows."""
        step = max(self.w.size // 8, 1)
        columns = (self.w, self.magnitude_db, self.phase_deg, self.coherence, self.random_error)
        formats = ("{:.3g}", "{:.1f}", "{:.0f}", "{:.2f}", "{:.3f}")
        rows = tuple(
            tuple(form.format(column[k]) for form, column in zip(formats, columns, strict=True))
            for k in range(0, self.w.size, step)
        )
        windows = ", ".join(f"{length:.3g}" for length in self.windows)
        return ShortTable(
            f"response of {self.output} to {self.input}, {self.unit}",
            ("w, rad/s", "dB", "deg", "coherence", "random error"),
            rows,
            (f"usable band {band_words(self.band)} rad/s; {self.w.size} frequencies; windows {windows} s",),
        )


def default_windows(w_min: float, w_max: float, total: float, longest_run: float) -> tuple[float, ...]:
    """Five window lengths [s] from 20 periods of w_max to min(T_rec/2, T_F/5) (Tischler & Remple 2012).

    w in rad/s; total: T_F, the time of all runs [s]; longest_run: stands for T_rec [s].
    """
    t_min = 20 * 2 * np.pi / w_max
    t_max = min(longest_run / 2, total / 5)
    t_max = max(t_max, min(1.5 * 2 * np.pi / w_min, longest_run / 2))
    t_min = min(t_min, t_max / 2)
    return tuple(float(t) for t in np.geomspace(t_min, t_max, 5))


LOWEST_BIN = 1.4  # of 2 pi/T_win: below it a Hann window takes in the mean and the drift


def frequency_grid(w_min: float, w_max: float, windows: Sequence[float], points: int = 120) -> Array:
    """Log-spaced frequencies [rad/s] from where the longest window still resolves, up to w_max."""
    return np.geomspace(max(w_min, LOWEST_BIN * 2 * np.pi / max(windows)), w_max, points)


def frequency_responses(
    runs: Sequence[Recording],
    outputs: Sequence[str],
    w: Array,
    windows: Sequence[float],
    input: str = "delta",
    bands: Mapping[str, Band] | None = None,
) -> dict[str, FrequencyResponse]:
    """Composite responses input -> outputs over all runs at w [rad/s] with windows [s].

    Outputs that vanish at w = 0 are jw times the response of their integral: vydot of vy (never a
    differentiated signal), p of the integrated roll rate. The slope of the window leaks an error of
    about 2 pi/(T_win w) of itself into a response that rises as w; into a flat one it leaks nothing
    (measured on the recordings' truth: 3 dB and 34 deg of p at .3-.5 rad/s became .5 dB and 12 deg).
    bands: overrides the automatic choice from the coherence.
    """
    channels = [{input: run.manoeuvre(input)} | {o: transformed(run, o) for o in outputs} for run in runs]
    spectra = window_spectra(channels, [run.span for run in runs], outputs, windows, w, input)
    per = runs[0][input].unit
    chosen = bands or {}
    return {
        o: composite_response(input, o, per, channels[0][o].unit, spectra[o], chosen.get(o)) for o in outputs
    }


RISING = {"vydot": "m/s^2", "p": "rad/s"}  # outputs got as jw times their integral, and their units


def transformed(run: Recording, output: str) -> Signal:
    """The signal whose transform is taken for an output."""
    if output == "p":
        return _integrated(run.manoeuvre("p"))
    return run.manoeuvre("vy" if output == "vydot" else output)


def _integrated(p: Signal) -> Signal:
    """The integral [rad] of a rate [rad/s], from its mean."""
    x = p.x - p.x.mean()
    angle = np.concatenate(([0.0], np.cumsum((x[1:] + x[:-1]) / 2 * np.diff(p.t))))
    return Signal(p.t, angle, "rad", f"integral of {p.source}")


def composite_response(
    input: str, output: str, per: str, unit: str, spectra: Sequence[WindowSpectra], band: Band | None
) -> FrequencyResponse:
    """The composite of several windows; per, unit: of the input and of the signal that was transformed."""
    w = spectra[0].w
    gxx, gyy, gxy = composite(spectra)
    coherence = np.abs(gxy) ** 2 / (gxx * gyy)
    rise = 1j * w if output in RISING else np.ones_like(w, dtype=complex)
    error = np.nanmin([s.random_error for s in spectra], axis=0)
    return FrequencyResponse(
        input,
        output,
        f"{RISING.get(output, unit)} per {per}",
        w,
        gxy / gxx * rise,
        coherence,
        error,
        gxx,
        gyy * np.abs(rise) ** 2,
        tuple(s.length for s in spectra),
        band or usable_band(w, coherence),
    )


def composite(spectra: Sequence[WindowSpectra]) -> tuple[Array, Array, Complex]:
    """Composite Gxx, Gyy, Gxy (n_w,) of several windows: minimises at each frequency

    sum_i W_i { ((Gxx-Gxx_i)/Gxx~)^2 + ((Gyy-Gyy_i)/Gyy~)^2 + ((Re-Re_i)/|Gxy~|)^2 + ((Im-Im_i)/|Gxy~|)^2
    + 5 ((g2-g2_i)/g2~)^2 }, W_i = (eps_i/eps_min)^-4, from starts G~ = sum W_i^2 G_i / sum W_i^2.
    """
    error = np.array([s.random_error for s in spectra])
    used = np.isfinite(error)
    weight = np.where(used, (np.where(used, error, 1.0) / np.nanmin(error, axis=0)) ** -4.0, 0.0)
    xx, yy, xy = (_filled([getattr(s, n) for s in spectra], used) for n in ("gxx", "gyy", "gxy"))
    start_weight = weight**2 / np.sum(weight**2, axis=0)
    xx0, yy0, xy0 = (np.sum(start_weight * g, axis=0) for g in (xx, yy, xy))
    g20 = np.abs(xy0) ** 2 / (xx0 * yy0)
    data = np.stack((xx / xx0, yy / yy0, xy.real / np.abs(xy0), xy.imag / np.abs(xy0)), axis=-1)
    g2 = np.where(used, np.abs(xy) ** 2 / np.where(used, xx * yy, 1.0), 0.0) / g20
    share = weight / np.sum(weight, axis=0)
    mean, coherence = np.sum(share[..., None] * data, axis=0), np.sum(share * g2, axis=0)
    unity = np.ones_like(g20)
    z = _solve(
        mean,
        coherence,
        np.column_stack((unity, unity, np.stack((xy0.real, xy0.imag), -1) / np.abs(xy0)[:, None])),
    )
    return z[:, 0] * xx0, z[:, 1] * yy0, (z[:, 2] + 1j * z[:, 3]) * np.abs(xy0)


def _filled(parts: Sequence[Array | Complex], used: np.ndarray) -> np.ndarray:
    return np.where(used, np.array(parts), 0.0)


def _solve(mean: Array, coherence: Array, start: Array) -> Array:
    """Normalised Gxx, Gyy, Re, Im (n_w, 4), at all frequencies at once, by Levenberg-Marquardt.

    The sum over the windows differs by a constant from sum W times |z - mean|^2 + 5 (c(z) - coherence)^2,
    mean (n_w, 4) and coherence (n_w,), over its start value, being weighted means over the windows.
    """
    z, damping = start.copy(), np.full(coherence.size, 1e-3)
    best = _objective(z, mean, coherence)
    at = np.arange(coherence.size)
    for _ in range(60):
        step = _step(z[at], mean[at], coherence[at], damping[at])
        trial = z[at] + step
        value = np.where(np.all(trial[:, :2] > 0, axis=1), _objective(trial, mean[at], coherence[at]), np.inf)
        better = value < best[at]
        z[at[better]], best[at[better]] = trial[better], value[better]
        damping[at] = np.where(better, damping[at] / 5, damping[at] * 4)
        at = at[np.max(np.abs(step), axis=1) >= 1e-10]
        if not at.size:
            break
    return z


def _coherence_of(z: Array) -> Array:
    """Over its start value."""
    return np.asarray((z[:, 2] ** 2 + z[:, 3] ** 2) / (z[:, 0] * z[:, 1]))


def _objective(z: Array, mean: Array, coherence: Array) -> Array:
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.sum((z - mean) ** 2, axis=1) + 5 * (_coherence_of(z) - coherence) ** 2


def _step(z: Array, mean: Array, coherence: Array, damping: Array) -> Array:
    """Damped Gauss-Newton step: the Hessian is diagonal plus 5 slope slope^T, inverted in closed form."""
    c = _coherence_of(z)
    power = z[:, 2] ** 2 + z[:, 3] ** 2
    slope = np.column_stack((-c / z[:, 0], -c / z[:, 1], 2 * c * z[:, 2] / power, 2 * c * z[:, 3] / power))
    gradient = z - mean + 5 * (c - coherence)[:, None] * slope
    diagonal = 1 + damping[:, None] * (1 + 5 * slope**2)
    g, s = gradient / diagonal, slope / diagonal
    along = 5 * np.sum(slope * g, axis=1) / (1 + 5 * np.sum(slope * s, axis=1))
    return np.asarray(s * along[:, None] - g)


def usable_band(w: Array, coherence: Array, good: float = COHERENCE_GOOD) -> Band | None:
    """The widest band (rad/s, in log w) of coherence >= good, local drops allowed between good sides.

    A drop may span 20 % of a decade when the coherence stays above half the limit, as the paper
    includes "local drops ... if the coherence is good on either side". None without a band of .3 decade.
    """
    x, ok = np.log10(w), coherence >= good
    runs = _stretches(ok)
    merged: list[tuple[int, int]] = []
    for lo, hi in runs:
        if merged and _bridgeable(x, coherence, merged[-1], (lo, hi), good):
            merged[-1] = (merged[-1][0], hi)
        else:
            merged.append((lo, hi))
    if not merged:
        return None
    lo, hi = max(merged, key=lambda s: x[s[1]] - x[s[0]])
    return (float(w[lo]), float(w[hi])) if x[hi] - x[lo] >= 0.3 else None


def _stretches(ok: np.ndarray) -> list[tuple[int, int]]:
    """(first, last) indices of each stretch of True."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], ok.astype(int), [0]))))
    return [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _bridgeable(
    x: Array, coherence: Array, left: tuple[int, int], right: tuple[int, int], good: float
) -> bool:
    """True for a narrow, shallow gap between two stretches (first, last) that are not mere points."""
    gap = slice(left[1], right[0] + 1)
    wide_sides = min(x[left[1]] - x[left[0]], x[right[1]] - x[right[0]]) > 0.05
    return bool(wide_sides and x[right[0]] - x[left[1]] <= 0.2 and np.min(coherence[gap]) >= good / 2)
