"""The error that every model of a rover has, as a term of the covariance.

No rover is a single track with roll: unsprung masses, a roll axis that nobody sees, Ackermann geometry,
creeping tyres, three dimensions. What they leave is no noise, and without this term an effect of the library
is fitted to it, and named. Three coefficients of the equations, alike in all runs, are known no better than:

    Y_f += C z_f p/V,  Y_r += C z_r p/V    z ~ N(0, (HEIGHT h)^2): the tyres' contact moves sideways with p
    N += t m a_y                           t ~ N(0, (TRAIL L)^2): pneumatic trail

And each modelled response is uncertain by `COMMON` of its gain, and by as much in phase [rad], in every
octave and alike in all runs, and by `OWN` in each run for itself:

    rows = (1 + sum over octaves k of (a_k + i b_k) hat_k(log2 f)) modelled rows,   a_k, b_k ~ N(0, rho^2)

The hats are linear in log2 f and sum to 1. Kennedy and O'Hagan 2001: Bayesian calibration of computer models
(the discrepancy), J. R. Statist. Soc. B 63(3); here it is relative, and a Gaussian process on few knots.
The four sizes are those under which healthy rovers of four engines are most probable.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import exp

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.posterior.transfers import added_rows, tapered_spectrum, transfers
from rover_sweep.diagnosis.problem.least_squares import Fitted
from rover_sweep.diagnosis.problem.residuals import Problem, Rows
from rover_sweep.diagnosis.problem.signatures import Signature

COMMON = 0.007  # standard deviation of the relative error that all runs share
OWN = 0.005  # of the one of each run
HEIGHT = 0.5  # of the contact's way sideways, over that of the CG
TRAIL = 0.025  # of the wheelbase
KNOTS = 0.04 * 2.0 ** np.arange(9)  # Hz, an octave apart, from below the sweeps to beyond the highest line


def structural_error(problem: Problem, fitted: Fitted) -> list[Signature]:
    """Its signatures at one standard deviation, of a problem without metric and the model fitted to it."""
    return [*errors_of_coefficients(problem, fitted), *errors_of_responses(problem, fitted)]


def errors_of_coefficients(problem: Problem, fitted: Fitted) -> Iterator[Signature]:
    """Of coefficients that a model with slipping tyres has, and no measurement decides."""
    structure, x = fitted.structure, fitted.x
    if structure.lumped or not structure.slip:
        return
    rover, stiffness = structure.rover, exp(x["ln_C"])
    parts = {"yaw moment": ("trail", TRAIL * rover.wheelbase * rover.mass)}
    if structure.roll and rover.h:
        height = HEIGHT * rover.h * exp(x.get("ln_h", 0.0))
        parts |= {f"side force {end}": (f"roll axis {end}", height * stiffness) for end in ("front", "rear")}
    found = transfers(problem.runs, structure, x, tuple(parts))
    for place, (name, size) in parts.items():
        driving = [t.motion["across"] if name == "trail" else t.motion["p"] / t.motion["V"] for t in found]
        spectra = [tapered_spectrum(t.run, size * s) for t, s in zip(found, driving, strict=True)]
        yield Signature("structure", name, 1.0, True, added_rows(problem.plain, found, place, spectra))


def errors_of_responses(problem: Problem, fitted: Fitted) -> list[Signature]:
    """Of gain and phase in each octave of each channel."""
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
