"""The verdict on a run from its coherence: keep it, or repeat it with which change."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from rover_sweep.data.recording import Array, Recording, data_frame
from rover_sweep.data.results import PlainNumbers, ShortTable, Shown, band_words
from rover_sweep.quality.faults import advice_on, is_short, is_unexcited, short_trials
from rover_sweep.spectra.amplitude import RISING_FROM, octaves, wanted_factor
from rover_sweep.spectra.conditioned import conditioned_responses
from rover_sweep.spectra.response import (
    COHERENCE_GOOD,
    RISING,
    Band,
    FrequencyResponse,
    default_windows,
    frequency_grid,
    frequency_responses,
)
from rover_sweep.spectra.windowed import Transformer

COVERED = 0.8  # of the swept range, in log w
VYDOT_FROM = 3.0  # rad/s: below it the EKF's lateral velocity is GPS correction (the paper used 3-25 rad/s)
SERVO_TRAVEL = 500.0  # us from the trim, when the log does not have it
WHEEL_LOCK = 0.6  # rad, largest road-wheel angle of a car or rover
LINE_GAP = 3.0  # rad/s, largest gap between excited lines of a multisine
LATERAL_LIMIT = 6.0  # m/s^2: above it a rover on asphalt slides or rolls over


@dataclass(frozen=True)
class OutputCoherence(PlainNumbers):
    """Coherence of one output: usable band [rad/s], covered: share of the range (in log w) at >= .6.

    lowest: smallest coherence, at lowest_at [rad/s].
    """

    output: str
    band: Band | None
    covered: float
    lowest: float
    lowest_at: float


@dataclass(frozen=True, repr=False)
class CoherenceVerdict(PlainNumbers, Shown):
    """Keep a run, or repeat it. range: excited (low, high) [rad/s]; amplitude in amplitude_unit.

    amplitude_factor: of the amplitude for a coherence of .8, None when kept. sentence: verdict and reason.
    """

    run: str
    keep: bool
    range: Band
    amplitude: float
    amplitude_unit: str
    amplitude_factor: float | None
    outputs: tuple[OutputCoherence, ...]
    sentence: str

    def table(self) -> ShortTable:
        """The usable band of each output; the verdict."""
        rows = tuple(
            (o.output, band_words(o.band), f"{100 * o.covered:.0f} %", f"{o.lowest:.2f} at {o.lowest_at:.2g}")
            for o in self.outputs
        )
        headings = ("output", "usable band, rad/s", "range at >= 0.6", "lowest coherence")
        return ShortTable(f"coherence of {self.run}", headings, rows, (self.sentence,))


class CoherenceTable(Shown, tuple[CoherenceVerdict, ...]):
    """The verdict on each run, in their order; it prints as one table."""

    __slots__ = ()
    __repr__ = Shown.__repr__

    def table(self) -> ShortTable:
        """A row for each run with its usable bands; below, a sentence on each run to repeat."""
        outputs = tuple(dict.fromkeys(o.output for v in self for o in v.outputs))
        rows = []
        for v in self:
            bands = {o.output: band_words(o.band) for o in v.outputs}
            amplitude = f"{v.amplitude:.3g} {v.amplitude_unit}"
            rows.append(
                (v.run, "keep" if v.keep else "repeat", amplitude, *(bands.get(o, "-") for o in outputs))
            )
        again = tuple(f"{v.run}: {v.sentence}" for v in self if not v.keep)
        title = "coherence at least 0.6, usable bands in rad/s"
        return ShortTable(title, ("run", "verdict", "amplitude", *outputs), tuple(rows), again)

    def to_frame(self) -> Any:
        """A row for each output of each run as a pandas.DataFrame; UsageError without pandas.

        Columns: run, keep, output, low and high [rad/s] of the usable band (nan for none), covered (share of
        the swept range), lowest (coherence), lowest_at [rad/s].
        """
        rows = [(v, o, o.band or (np.nan, np.nan)) for v in self for o in v.outputs]
        columns = {
            "run": [v.run for v, _, _ in rows],
            "keep": [v.keep for v, _, _ in rows],
            "output": [o.output for _, o, _ in rows],
            "low": [band[0] for _, _, band in rows],
            "high": [band[1] for _, _, band in rows],
            "covered": [o.covered for _, o, _ in rows],
            "lowest": [o.lowest for _, o, _ in rows],
            "lowest_at": [o.lowest_at for _, o, _ in rows],
        }
        return data_frame(columns)


def excited_range(runs: Sequence[Recording], input: str = "delta", top: float | None = None) -> Band:
    """(low, high) [rad/s] around the strongest frequency, with steering power within 20 dB of the median.

    Gaps between the lines of a multisine are bridged. Limits: 2 pi/(half the longest run, or the longest of
    many short trials), and `top` (60 rad/s by default) or .8 of the lowest Nyquist frequency.
    """
    longest = max(run.span[1] - run.span[0] for run in runs)
    share = 1 if short_trials(runs) else 2
    nyquist = np.pi * min(run[c].rate for run in runs for c in (input, "r") if c in run)
    w = np.geomspace(2 * np.pi * share / longest, min(top or 60.0, 0.8 * nyquist), 150)
    power = np.sum([_power(run, input, w, longest / (2 * share)) for run in runs], axis=0)
    strong = power > 1e-2 * np.median(power[power > 1e-3 * power.max()])
    peak = int(np.argmax(power))
    if any(run.kind == "multisine" for run in runs) or short_trials(runs):
        strong = _without_gaps(w, strong)
    below, above = np.flatnonzero(~strong[:peak]), np.flatnonzero(~strong[peak:])
    low = int(below[-1]) + 1 if below.size else 0
    high = peak + int(above[0]) - 1 if above.size else w.size - 1
    return float(w[low]), float(w[high])


def _without_gaps(w: Array, strong: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The mask (n_w,) with gaps of up to LINE_GAP between excited frequencies filled."""
    filled, k = strong.copy(), np.flatnonzero(strong)
    for a, b in zip(k[:-1], k[1:], strict=True):
        filled[a:b] |= w[b] - w[a] <= LINE_GAP
    return filled


def _power(run: Recording, input: str, w: Array, length: float) -> Array:
    length = min(length, run.span[1] - run.span[0])
    return np.mean(np.abs(Transformer(*run.span, [length], w)(run.manoeuvre(input))[0]) ** 2, axis=0)


def responses(
    runs: Sequence[Recording],
    outputs: Sequence[str] = ("r", "ay", "vydot", "p"),
    input: str = "delta",
    band: Band | None = None,
    windows: Sequence[float] | None = None,
    bands: Mapping[str, Band] | None = None,
) -> dict[str, FrequencyResponse]:
    """{output: composite response} of all recorded outputs, over the excited range.

    band: swept range [rad/s], default the excited one; windows [s]: default five lengths; bands: {output:
    usable band [rad/s]}, default from the coherence.
    """
    return input_responses(runs, (input,), outputs, band, windows, bands)[input]


@threadpool_limits.wrap(
    limits=1, user_api="blas"
)  # idle threads of small products cost 2 to 10 times as much
def input_responses(
    runs: Sequence[Recording],
    inputs: Sequence[str],
    outputs: Sequence[str] = ("r", "ay", "vydot", "p"),
    band: Band | None = None,
    windows: Sequence[float] | None = None,
    bands: Mapping[str, Band] | None = None,
) -> dict[str, dict[str, FrequencyResponse]]:
    """{input: {output: response}}; each of several inputs is conditioned on the others.

    The first input is the swept one. band and windows as in `responses`; bands for the first input. With
    several inputs long windows are shortened, because each input needs an independent average.
    """
    spans = [run.span for run in runs]
    total, longest = sum(e - s for s, e in spans), max(e - s for s, e in spans)
    low, high = _extended(band or excited_range(runs, inputs[0]), bands)
    record = 2 * longest if short_trials(runs) else longest  # a window may be as long as a short trial
    lengths = windows or default_windows(low, high, total, record)
    if len(inputs) > 1:
        lengths = tuple(sorted({min(n, total / len(inputs)) for n in lengths}))
    w = frequency_grid(low, high, lengths)
    recorded = [o for o in outputs if all({"vydot": "vy"}.get(o, o) in run for run in runs)]
    if len(inputs) > 1:
        found = conditioned_responses(runs, recorded, w, lengths, inputs, bands)
    else:
        found = {inputs[0]: frequency_responses(runs, recorded, w, tuple(lengths), inputs[0], bands)}
    if "vydot" in recorded and "vydot" not in (bands or {}):
        found[inputs[0]]["vydot"] = _above(found[inputs[0]]["vydot"], VYDOT_FROM)
    return found


def _above(f: FrequencyResponse, low: float) -> FrequencyResponse:
    """The response with its band limited to above `low` [rad/s]."""
    if f.band is None or f.band[1] < 2 * low:
        return replace(f, band=None)
    return replace(f, band=(max(f.band[0], low), f.band[1]))


def _extended(swept: Band, bands: Mapping[str, Band] | None) -> Band:
    """The range, extended to the requested bands."""
    asked = [swept, *(bands or {}).values()]
    return min(b[0] for b in asked), max(b[1] for b in asked)


def assess(run: Recording, found: Mapping[str, FrequencyResponse] | None = None) -> CoherenceVerdict:
    """The verdict on one run from the coherence of r and a_y over the excited range.

    found: the run's responses, if already computed; conditioned ones are judged by partial coherence. The
    roll rate is judged only when it has a usable band.
    """
    input = "delta" if "delta" in run else "pwm"
    fault = advice_on(run)
    if fault and is_unexcited(run):
        unit = run[input].unit
        return CoherenceVerdict(run.name, False, (0.0, 0.0), 0.0, unit, None, (), fault[1])
    measured = found or responses([run], input=input)
    outputs = tuple(_output(f) for f in measured.values())
    judged = list(judged_responses(measured).values())
    worst = min(judged, key=lambda f: _output(f).covered)
    signal = run.manoeuvre("pwm" if "pwm" in run else input)
    amplitude = float(np.ptp(signal.x)) / 2
    unit = "us" if signal.unit == "us" else signal.unit
    swept = (float(worst.w[0]), float(worst.w[-1]))
    keep = _output(worst).covered >= COVERED
    factor = None if keep else _factor(judged)
    peak = _peak(measured, float(np.ptp(run.manoeuvre(input).x)) / 2) * (factor or 1.0)
    if fault:
        return CoherenceVerdict(run.name, False, swept, amplitude, unit, None, outputs, fault[1])
    if run.kind == "doublet":
        sentence = "doublet: for verification, so its coherence is not judged"
        return CoherenceVerdict(run.name, True, swept, amplitude, unit, None, outputs, sentence)
    if run.kind == "other" and is_short(run):
        sentence = "short trial: one average of many, so its own coherence is not judged"
        return CoherenceVerdict(run.name, True, swept, amplitude, unit, None, outputs, sentence)
    sentence = (
        _keep_sentence(outputs, swept, _kind(worst))
        if keep
        else _repeat_sentence(
            worst, amplitude, unit, factor or 1.0, peak, max(_steering_travel(run, unit), amplitude)
        )
    )
    return CoherenceVerdict(run.name, keep, swept, amplitude, unit, factor, outputs, sentence)


def judged_responses(found: Mapping[str, FrequencyResponse]) -> dict[str, FrequencyResponse]:
    """The responses that a run is judged by: r, a_y, and p of a rover that rolls."""
    return {name: f for name, f in found.items() if name in ("r", "ay") or (name == "p" and f.band)}


def _output(f: FrequencyResponse) -> OutputCoherence:
    w, g2 = _judged(f)
    lowest = int(np.argmin(g2))
    return OutputCoherence(
        f.output, f.band, float(np.mean(g2 >= COHERENCE_GOOD)), float(g2[lowest]), float(w[lowest])
    )


def _judged(f: FrequencyResponse) -> tuple[Array, Array]:
    """(w, coherence) that are judged: responses that rise with w are lost in noise at the low end.

    For them, from 4 times the lowest frequency, or the upper half of a narrow range.
    """
    start = min(RISING_FROM * f.w[0], np.sqrt(f.w[0] * f.w[-1])) if f.output in RISING else f.w[0]
    return f.w[f.w >= start], f.coherence[f.w >= start]


def _factor(judged: Sequence[FrequencyResponse]) -> float:
    """Factor of the amplitude that gives every octave the wanted coherence (see `amplitude`)."""
    needs = [
        need[0]
        for f in judged
        for low, high in pairwise(octaves(float(f.w[0]), float(f.w[-1])).tolist())
        if (need := wanted_factor(f, low, high)) is not None
    ]
    return float(np.clip(max(needs, default=1.0), 1.2, 12.0))


def _kind(f: FrequencyResponse) -> str:
    return (
        f"partial coherence (effect of {' and '.join(f.conditioned_on)} removed)"
        if f.conditioned_on
        else "coherence"
    )


def _keep_sentence(outputs: Sequence[OutputCoherence], swept: Band, kind: str) -> str:
    bands = ", ".join(f"{o.output} {o.band[0]:.2g}-{o.band[1]:.3g}" for o in outputs if o.band)
    poor = [o.output for o in outputs if o.band is None]
    rest = f"; {', '.join(poor)} not usable" if poor else ""
    return f"keep: {kind} >= 0.6 over {swept[0]:.2g}-{swept[1]:.3g} rad/s ({bands} rad/s{rest})"


def _peak(found: Mapping[str, FrequencyResponse], amplitude: float) -> float:
    """Largest a_y [m/s^2] due to a steering amplitude (in the input's unit), without noise."""
    ay = found.get("ay")
    return amplitude * float(np.max(np.abs(ay.h) * np.sqrt(ay.coherence))) if ay else 0.0


def _repeat_sentence(
    f: FrequencyResponse, amplitude: float, unit: str, factor: float, peak: float, travel: float
) -> str:
    w, g2 = _judged(f)
    low = w[g2 < COHERENCE_GOOD]
    where = f"{low[0]:.2g}-{low[-1]:.3g} rad/s"
    wanted = amplitude * factor
    value = f"{wanted:.0f} us" if unit == "us" else f"{wanted:.2g} {unit}"
    why = (
        f"{_kind(f)} of {f.output} is below 0.6 over {100 * np.mean(g2 < COHERENCE_GOOD):.0f} % "
        f"of the range ({where}, median {np.median(g2):.2f})"
    )
    if wanted > travel:
        most = f"{travel:.0f} us" if unit == "us" else f"{travel:.2g} {unit}"
        return (
            f"repeat at a higher speed, with a longer T_rec or with a lower w_max: {why}; an amplitude of "
            f"{value} would be needed, but the steering reaches only {most}"
        )
    sentence = f"repeat with {factor:.1f} times the amplitude ({value} instead of {amplitude:.3g}): {why}"
    if peak > LATERAL_LIMIT:
        sentence += f"; a_y would then reach about {peak:.0f} m/s^2, so lengthen T_rec or lower w_max instead"
    return sentence


def _steering_travel(run: Recording, unit: str) -> float:
    """Largest steering amplitude [us or rad], from SERVOn_MIN, _MAX and _TRIM if logged."""
    ends = {name.rpartition("_")[2]: float(x) for name, x in run.vehicle.items() if name.startswith("SERVO")}
    if unit != "us":
        return WHEEL_LOCK
    if not {"MIN", "MAX", "TRIM"} <= set(ends):
        return SERVO_TRAVEL
    return min(ends["MAX"] - ends["TRIM"], ends["TRIM"] - ends["MIN"])


def sign_is_wrong(response: FrequencyResponse) -> bool:
    """True when r has the opposite sign of the steering in the lower half of the band."""
    low, high = response.band or (response.w[0], response.w[-1])
    inside = (response.w >= low) & (response.w <= np.sqrt(low * high))
    return bool(np.sum((response.h * response.coherence)[inside]).real < 0)
