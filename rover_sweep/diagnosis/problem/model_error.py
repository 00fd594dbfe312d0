"""The smooth relative error that every model of a rover has, as a term of the covariance.

No rover is a single track with roll: unsprung masses, a roll axis that nobody sees, Ackermann geometry,
creeping tyres, three dimensions. What they leave is small and smooth in frequency. Without this term an
effect of the library is fitted to it, and named. Each modelled response is uncertain by `COMMON` of its gain,
and by as much in phase [rad], in every octave and alike in all runs, and by `OWN` in each run for itself:

    rows = (1 + sum over octaves k of (a_k + i b_k) hat_k(log2 f)) modelled rows,   a_k, b_k ~ N(0, rho^2)

The hats are linear in log2 f and sum to 1. Kennedy and O'Hagan 2001: Bayesian calibration of computer models
(the discrepancy), J. R. Statist. Soc. B 63(3); here it is relative, and a Gaussian process on few knots.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.problem.least_squares import Fitted
from rover_sweep.diagnosis.problem.residuals import Problem, Rows
from rover_sweep.diagnosis.problem.signatures import Signature

COMMON = 0.02  # standard deviation of the relative error that all runs share
OWN = 0.01  # of the one of each run
KNOTS = 0.04 * 2.0 ** np.arange(9)  # Hz, an octave apart, from below the sweeps to beyond the highest line


def model_error(problem: Problem, fitted: Fitted) -> list[Signature]:
    """Its signatures at one standard deviation, of a problem without metric and the model fitted to it."""
    modelled = problem.plain_models(fitted.structure, [fitted.x])[0]
    out = []
    for channel in dict.fromkeys(r.channel for r in problem.rows):
        runs = [r for r in problem.rows if r.channel == channel]
        for size, members in ((COMMON, runs), *((OWN, [r]) for r in runs if len(runs) > 1)):
            out += list(_of_response(channel, size, members, modelled))
    return out


def _of_response(channel: str, size: float, members: list[Rows], modelled: Array) -> Iterator[Signature]:
    """The signatures of one channel in some runs: gain and phase of each octave that their lines reach."""
    for knot in range(KNOTS.size):
        gain, phase = np.zeros(modelled.size), np.zeros(modelled.size)
        for r in members:
            hat = size * _hat(knot, r.f)
            real, imag = slice(r.start, r.start + r.bins.size), slice(r.start + r.bins.size, r.start + r.size)
            gain[real], gain[imag] = hat * modelled[real], hat * modelled[imag]
            phase[real], phase[imag] = -hat * modelled[imag], hat * modelled[real]
        if gain.any():
            yield Signature("structure", f"gain of {channel} at {KNOTS[knot]:.3g} Hz", size, True, gain)
            yield Signature("structure", f"phase of {channel} at {KNOTS[knot]:.3g} Hz", size, True, phase)


def _hat(knot: int, f: Array) -> Array:
    """The hat (k,) of one knot over log2 of f (k,) [Hz]; the first and the last go on beyond the knots."""
    place = np.log2(np.clip(f, KNOTS[0], KNOTS[-1]) / KNOTS[0])
    return np.maximum(0.0, 1.0 - np.abs(place - knot))
