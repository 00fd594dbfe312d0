"""The responses of a run to its steering, and how much of each is coherent."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from rover_sweep.data.recording import Recording
from rover_sweep.data.results import PlainNumbers
from rover_sweep.quality.faults import short_trials
from rover_sweep.spectra.amplitude import judged_from
from rover_sweep.spectra.response import (
    COHERENCE_GOOD,
    Band,
    FrequencyResponse,
    default_windows,
    frequency_grid,
    frequency_responses,
)
from rover_sweep.spectra.windowed import Transformer

VYDOT_FROM = 3.0  # rad/s: below it the EKF's lateral velocity is GPS correction (the paper used 3-25 rad/s)
LINE_GAP = 3.0  # rad/s, largest gap between excited lines of a multisine


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


def excited_range(runs: Sequence[Recording], input: str = "delta", top: float | None = None) -> Band:
    """(low, high) [rad/s] around the strongest frequency, with steering power within 20 dB of the median.

    Gaps between the lines of a multisine are bridged. Limits: 2 pi/(half the longest run, or the longest of
    many short trials), and `top` (60 rad/s by default) or .8 of the lowest Nyquist frequency.
    """
    longest = max(run.span[1] - run.span[0] for run in runs)
    share = 1 if short_trials(runs) else 2
    nyquist = np.pi * min(run[c].rate for run in runs for c in (input, "r") if c in run)
    w = np.geomspace(2 * np.pi * share / longest, min(top or 60.0, 0.8 * nyquist), 150)
    length = longest / (2 * share)
    power = np.zeros(w.size)
    for run in runs:
        fitting = min(length, run.span[1] - run.span[0])
        spectra = Transformer(*run.span, [fitting], w)(run.manoeuvre(input))[0]
        power = power + np.mean(np.abs(spectra) ** 2, axis=0)
    strong = power > 1e-2 * np.median(power[power > 1e-3 * power.max()])
    peak = int(np.argmax(power))
    if any(run.kind == "multisine" for run in runs) or short_trials(runs):
        k = np.flatnonzero(strong)
        for a, b in zip(k[:-1], k[1:], strict=True):
            strong[a:b] |= w[b] - w[a] <= LINE_GAP
    below, above = np.flatnonzero(~strong[:peak]), np.flatnonzero(~strong[peak:])
    low = int(below[-1]) + 1 if below.size else 0
    high = peak + int(above[0]) - 1 if above.size else w.size - 1
    return float(w[low]), float(w[high])


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
    asked = [band or excited_range(runs, inputs[0]), *(bands or {}).values()]
    low, high = min(b[0] for b in asked), max(b[1] for b in asked)
    record = 2 * longest if short_trials(runs) else longest  # a window may be as long as a short trial
    lengths = windows or default_windows(low, high, total, record)
    if len(inputs) > 1:
        lengths = tuple(sorted({min(n, total / len(inputs)) for n in lengths}))
    w = frequency_grid(low, high, lengths)
    recorded = [o for o in outputs if all({"vydot": "vy"}.get(o, o) in run for run in runs)]
    found = frequency_responses(runs, recorded, w, tuple(lengths), inputs, bands)
    if "vydot" in recorded and "vydot" not in (bands or {}):
        f, low = found[inputs[0]]["vydot"], VYDOT_FROM
        above = None if f.band is None or f.band[1] < 2 * low else (max(f.band[0], low), f.band[1])
        found[inputs[0]]["vydot"] = replace(f, band=above)
    return found


def judged_responses(found: Mapping[str, FrequencyResponse]) -> dict[str, FrequencyResponse]:
    """The responses that a run is judged by: r, a_y, and p of a rover that rolls."""
    return {name: f for name, f in found.items() if name in ("r", "ay") or (name == "p" and f.band)}


def output_coherence(f: FrequencyResponse) -> OutputCoherence:
    judged = f.w >= judged_from(f)
    w, g2 = f.w[judged], f.coherence[judged]
    lowest = int(np.argmin(g2))
    return OutputCoherence(
        f.output, f.band, float(np.mean(g2 >= COHERENCE_GOOD)), float(g2[lowest]), float(w[lowest])
    )


def sign_is_wrong(response: FrequencyResponse, speed: float) -> bool:
    """True when r lacks the sign of the steering times the speed [m/s] in the lower half of the band."""
    low, high = response.band or (response.w[0], response.w[-1])
    inside = (response.w >= low) & (response.w <= np.sqrt(low * high))
    return bool(np.sum((response.h * response.coherence)[inside]).real * np.sign(speed) < 0)


def per_rad(f: FrequencyResponse, rad_per_us: float) -> FrequencyResponse:
    """The response to the road-wheel angle; in ArduPilot a larger PWM turns right."""
    return f if f.input == "delta" else replace(f, h=f.h / -rad_per_us, input="delta")
