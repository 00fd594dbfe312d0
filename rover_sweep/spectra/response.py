"""Composite frequency responses from several window lengths and runs, with coherence and random error.

Composite windowing (Tischler & Remple 2012, section 10.4) finds at each frequency the Gxx, Gyy, Re Gxy, Im
Gxy closest to those of the windows i, with weights W_i = (eps_i/eps_min)^-4 of their random errors. With ~
for the starting values, z = (Gxx/Gxx~, Gyy/Gyy~, Re/|Gxy~|, Im/|Gxy~|), d_i the same of window i, and
c = g2/g2~ = (z3^2 + z4^2)/(z1 z2), it minimises sum_i W_i [ |z - d_i|^2 + 5 (c(z) - c_i)^2 ]. (The book
divides Re and Im by their own starting values, which pass through zero.) Such a sum differs from

    F(z) = |z - m|^2 + 5 (c(z) - c_m)^2,   m = sum W_i d_i / sum W_i,   c_m = sum W_i c_i / sum W_i

times sum W_i by a constant only, so the windows enter by their means. Gauss-Newton with s = dc/dz: half the
gradient is g = z - m + 5 (c - c_m) s, half the Hessian D + 5 s s^T, with D = I plus the damping. By
Sherman-Morrison the step is -D^-1 g + 5 D^-1 s (s^T D^-1 g) / (1 + 5 s^T D^-1 s), for all frequencies at
once.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rover_sweep.data.recording import Array, Complex, Recording, Signal, data_frame, drawing, stretches
from rover_sweep.data.results import PlainNumbers, ShortTable, Shown, band_words
from rover_sweep.spectra.windowed import WindowSpectra, input_spectra

COHERENCE_GOOD = 0.6  # guideline of Tischler & Remple 2012
CORRELATED = 0.5  # coherence between inputs, above which T&R (chapter 9) advise to repeat the run
Band = tuple[float, float]


@dataclass(frozen=True, eq=False, repr=False)
class FrequencyResponse(PlainNumbers, Shown):
    """Response of an output to an input: h (n_w,), complex, in `unit` (output per input) at w (n_w,) [rad/s].

    coherence (n_w,): 0..1; random_error (n_w,): normalised sd of |h|. gxx, gyy (n_w,): composite autospectra,
    unit^2 s. windows: lengths [s]. band: usable (low, high) [rad/s], None for none. conditioned_on: inputs
    whose effect is removed; coherence is then the partial one. multiple_coherence (n_w,): share of the output
    that follows all inputs; input_coherence (n_w,): share of this input that follows the others.
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
        """20 log10 |h| (n_w,)."""
        return 20 * np.log10(np.abs(self.h))

    @property
    def phase_deg(self) -> Array:
        """Phase (n_w,), deg, unwrapped from the lowest frequency upwards."""
        return np.degrees(np.unwrap(np.angle(self.h)))

    def at(self, w: Array) -> tuple[Complex, Array]:
        """(h, coherence) at other frequencies w (n,) [rad/s], interpolated over log w in dB and phase."""
        x, grid = np.log(w), np.log(self.w)
        db, phase = np.interp(x, grid, self.magnitude_db), np.interp(x, grid, np.unwrap(np.angle(self.h)))
        return np.asarray(10 ** (db / 20) * np.exp(1j * phase), complex), np.interp(x, grid, self.coherence)

    def plot(self, axes: Any = None) -> Any:
        """Draws magnitude, phase and coherence and returns their matplotlib axes (3,).

        Grey: two standard deviations. Orange lines: the usable band. axes: three to draw on; default a new
        figure. UsageError for another number of axes.

        >>> magnitude, phase, coherence = result.responses["r"].plot()
        >>> magnitude.get_ylabel(), coherence.get_xlabel()
        ('magnitude, dB', 'frequency, rad/s')
        """
        return drawing("draw_one_response")(self, axes)

    def to_frame(self) -> Any:
        """A pandas.DataFrame with the frequency w [rad/s] as index; UsageError without pandas.

        Columns: h (complex, in `unit`), magnitude_db, phase_deg, coherence, random_error, and usable (bool,
        within the band).

        >>> frame = result.responses["r"].to_frame()
        >>> frame.index.name, list(frame.columns)
        ('w', ['h', 'magnitude_db', 'phase_deg', 'coherence', 'random_error', 'usable'])
        """
        low, high = self.band or (np.inf, -np.inf)
        columns = {
            "h": self.h,
            "magnitude_db": self.magnitude_db,
            "phase_deg": self.phase_deg,
            "coherence": self.coherence,
            "random_error": self.random_error,
            "usable": (self.w >= low) & (self.w <= high),
        }
        return data_frame(columns, self.w, "w")

    def table(self) -> ShortTable:
        """About nine frequencies, the usable band, the windows."""
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

    w in rad/s; total: T_F, time of all runs [s]; longest_run: taken as T_rec [s]. t_max is at least
    1.5 periods of w_min, if half the longest run allows it.
    """
    t_min = 20 * 2 * np.pi / w_max
    t_max = min(longest_run / 2, total / 5)
    t_max = max(t_max, min(1.5 * 2 * np.pi / w_min, longest_run / 2))
    t_min = min(t_min, t_max / 2)
    return tuple(float(t) for t in np.geomspace(t_min, t_max, 5))


LOWEST_BIN = 1.4  # of 2 pi/T_win: below it a Hann window leaks the mean and the drift


def frequency_grid(w_min: float, w_max: float, windows: Sequence[float], points: int = 120) -> Array:
    """Log-spaced frequencies (points,) [rad/s] from the lowest that the longest window resolves to w_max."""
    return np.geomspace(max(w_min, LOWEST_BIN * 2 * np.pi / max(windows)), w_max, points)


def frequency_responses(
    runs: Sequence[Recording],
    outputs: Sequence[str],
    w: Array,
    windows: Sequence[float],
    inputs: Sequence[str] = ("delta",),
    bands: Mapping[str, Band] | None = None,
) -> dict[str, dict[str, FrequencyResponse]]:
    """{input: {output: composite response}} over all runs, at w (n_w,) [rad/s] with windows [s].

    Each of several inputs is conditioned on the others: coherence is then the partial coherence, gxx and gyy
    are the conditioned autospectra. Outputs that are zero at w = 0 are computed as jw times the response of
    their integral: vydot from vy (never by differentiation), p from the integrated roll rate. A window leaks
    about 2 pi/(T_win w) of a response that rises with w, and nothing of a flat one. (On recordings with known
    truth the error of p at .3-.5 rad/s fell from 3 dB and 34 deg to .5 dB and 12 deg.) bands: {output: usable
    band [rad/s]} of the first input, default from the coherence.
    """
    channels = [
        {i: run.manoeuvre(i) for i in inputs} | {f"to {o}": transformed(run, o) for o in outputs}
        for run in runs
    ]
    spans, names = [run.span for run in runs], [f"to {o}" for o in outputs]
    spectra = input_spectra(channels, spans, inputs, names, windows, w)
    units = {name: signal.unit for name, signal in channels[0].items()}
    found: dict[str, dict[str, FrequencyResponse]] = {i: {} for i in inputs}
    for i in inputs:
        for o in outputs:
            parts = [s.conditioned(i, f"to {o}") for s in spectra]
            band = (bands or {}).get(o) if i == inputs[0] else None
            f = composite_response(i, o, units[i], units[f"to {o}"], parts, band)
            if len(inputs) > 1:
                weight = _weights(parts)
                f = replace(
                    f,
                    conditioned_on=tuple(n for n in inputs if n != i),
                    multiple_coherence=_mean(weight, [s.multiple_coherence(f"to {o}") for s in spectra]),
                    input_coherence=_mean(weight, [s.input_coherence(i) for s in spectra]),
                )
            found[i][o] = f
    return found


def _weights(parts: Sequence[WindowSpectra]) -> Array:
    """W_i^2 (n_windows, n_w) of the composite's starting values, 0 where a window does not resolve w."""
    error = np.array([s.random_error for s in parts])
    return np.where(np.isfinite(error), (error / np.nanmin(error, axis=0)) ** -8.0, 0.0)


def _mean(weight: Array, values: Sequence[Array]) -> Array:
    usable = np.where(weight > 0, np.array(values), 0.0)
    return np.asarray(np.sum(weight * usable, axis=0) / np.sum(weight, axis=0))


def moving(runs: Sequence[Recording], channel: str) -> bool:
    """True when a channel varies within the manoeuvres, as an input must."""
    parts = [run.manoeuvre(channel).x for run in runs]
    return any(x.size and float(np.ptp(x)) > 1e-9 * float(np.max(np.abs(x))) for x in parts)


def correlated_inputs(response: FrequencyResponse) -> str | None:
    """A sentence when the input is strongly correlated with the others in the usable band, else None."""
    if response.input_coherence is None or response.band is None:
        return None
    low, high = response.band
    inside = (response.w >= low) & (response.w <= high)
    shared = float(np.mean(response.input_coherence[inside]))
    if shared <= CORRELATED:
        return None
    others = " and ".join(response.conditioned_on)
    return (
        f"{others} moves with the steering (mean coherence {shared:.2f} over {low:.2g}-{high:.3g} rad/s, "
        f"guideline <= {CORRELATED:g}), so their effects cannot be separated well: drive again with "
        f"{others} constant or moved independently"
    )


RISING = {"vydot": "m/s^2", "p": "rad/s"}  # outputs computed as jw times their integral, and their units


def transformed(run: Recording, output: str) -> Signal:
    """The signal that is transformed for an output: vy for vydot, the integral of p for p."""
    if output == "p":
        return _integrated(run.manoeuvre("p"))
    return run.manoeuvre("vy" if output == "vydot" else output)


def _integrated(p: Signal) -> Signal:
    """The integral [rad] of a rate [rad/s] minus its mean."""
    x = p.x - p.x.mean()
    angle = np.concatenate(([0.0], np.cumsum((x[1:] + x[:-1]) / 2 * np.diff(p.t))))
    return Signal(p.t, angle, "rad", f"integral of {p.source}")


def composite_response(
    input: str, output: str, per: str, unit: str, spectra: Sequence[WindowSpectra], band: Band | None
) -> FrequencyResponse:
    """The composite of several window lengths. per, unit: of the input and of the transformed signal."""
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
    """Composite Gxx, Gyy, Gxy (n_w,), unit^2 s, of several window lengths, as in the module's text.

    Starting values: G~ = sum W_i^2 G_i / sum W_i^2. Windows count only where they resolve w.
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
    """z (n_w, 4) that minimises F at all frequencies at once, by Levenberg-Marquardt.

    mean (n_w, 4): m; coherence (n_w,): c_m of the module's text.
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
    """c(z) (n_w,), the coherence over its starting value."""
    return np.asarray((z[:, 2] ** 2 + z[:, 3] ** 2) / (z[:, 0] * z[:, 1]))


def _objective(z: Array, mean: Array, coherence: Array) -> Array:
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.sum((z - mean) ** 2, axis=1) + 5 * (_coherence_of(z) - coherence) ** 2


def _step(z: Array, mean: Array, coherence: Array, damping: Array) -> Array:
    """The damped Gauss-Newton step (n_w, 4) of the module's text; slope is s, diagonal is D."""
    c = _coherence_of(z)
    power = z[:, 2] ** 2 + z[:, 3] ** 2
    slope = np.column_stack((-c / z[:, 0], -c / z[:, 1], 2 * c * z[:, 2] / power, 2 * c * z[:, 3] / power))
    gradient = z - mean + 5 * (c - coherence)[:, None] * slope
    diagonal = 1 + damping[:, None] * (1 + 5 * slope**2)
    g, s = gradient / diagonal, slope / diagonal
    along = 5 * np.sum(slope * g, axis=1) / (1 + 5 * np.sum(slope * s, axis=1))
    return np.asarray(s * along[:, None] - g)


def usable_band(w: Array, coherence: Array, good: float = COHERENCE_GOOD) -> Band | None:
    """The widest band (low, high) [rad/s], in log w, with coherence >= good; None if below .3 decade.

    w, coherence (n_w,). Like the paper ("local drops ... if the coherence is good on either side"), it allows
    drops of up to 20 % of a decade in which the coherence stays above half of `good`.
    """
    x, ok = np.log10(w), coherence >= good
    merged: list[tuple[int, int]] = []
    for lo, hi in stretches(ok):
        if merged and _bridgeable(x, coherence, merged[-1], (lo, hi), good):
            merged[-1] = (merged[-1][0], hi)
        else:
            merged.append((lo, hi))
    if not merged:
        return None
    lo, hi = max(merged, key=lambda s: x[s[1]] - x[s[0]])
    return (float(w[lo]), float(w[hi])) if x[hi] - x[lo] >= 0.3 else None


def _bridgeable(
    x: Array, coherence: Array, left: tuple[int, int], right: tuple[int, int], good: float
) -> bool:
    """True for a narrow, shallow gap between two stretches (first, last) of more than .05 decade."""
    gap = slice(left[1], right[0] + 1)
    wide_sides = min(x[left[1]] - x[left[0]], x[right[1]] - x[right[0]]) > 0.05
    return bool(wide_sides and x[right[0]] - x[left[1]] <= 0.2 and np.min(coherence[gap]) >= good / 2)


# The phase of a response as it is drawn.


def inside_band(f: FrequencyResponse) -> np.ndarray:
    """(n_w,) True within the usable band; everywhere without a band."""
    low, high = f.band or (f.w[0], f.w[-1])
    return (f.w >= low * 0.999) & (f.w <= high * 1.001)


def unwrapped_phase(h: Complex, f: FrequencyResponse) -> Array:
    """Phase [deg] unwrapped outwards from the middle of the band, so that noise outside does not affect it.

    Without a band the phase is not unwrapped: it stays within +-180.
    """
    if f.band is None:
        return np.degrees(np.angle(h))
    inside = np.flatnonzero(inside_band(f))
    middle = int(inside[inside.size // 2])
    angle = np.angle(h)
    right = np.unwrap(angle[middle:])
    left = np.unwrap(angle[: middle + 1][::-1])[::-1]
    deg = np.degrees(np.concatenate((left[:-1], right)))
    return deg - 360.0 * np.round((deg[inside[0]] - 1e-9) / 360.0)


def nearest_turn(deg: Array, reference: Array, f: FrequencyResponse) -> Array:
    """The phase shifted by multiples of 360 deg to be closest to the reference in the band."""
    inside = inside_band(f)
    return deg - 360.0 * np.round(float(np.median(deg[inside] - reference[inside])) / 360.0)
