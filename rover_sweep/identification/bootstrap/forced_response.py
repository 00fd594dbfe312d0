"""What a model answers to the measured steering, free of any integration error."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from rover_sweep.data.recording import Array, LowPass, Signal
from rover_sweep.identification.structure.state_space import ModelStructure
from rover_sweep.spectra.spectra import Complex

RATE = 1000.0  # Hz: the samples between are interpolated
TOP = 8.0  # of w_max: above it neither the input nor the model says anything about the band
REST = 10.0  # s after the run in which the steering goes back and the answer dies out


def forced_response(
    structure: ModelStructure,
    speed: float,
    delta: Signal,
    span: tuple[float, float],
    outputs: Sequence[str],
    w_max: float,
    filters: Mapping[str, LowPass],
) -> dict[str, Signal]:
    """Outputs on a clock of 1 kHz over `span`, up to a constant, through the exact frequency response.

    The steering angle [rad] is taken as at rest before the run. vydot is given as its integral, V_y
    [m/s], which is what was measured. No step size and no held input put a delay into the answer, and a
    model with an unstable pole answers as its frequency response does.
    """
    start, end = span
    t = start + np.arange(int((end - start) * RATE) + 1) / RATE
    u = _returning(delta.on(t))
    w = np.asarray(2 * np.pi * np.fft.rfftfreq(u.size, 1 / RATE), dtype=np.float64)
    used = np.flatnonzero((w > 0) & (w <= TOP * w_max))
    x = np.fft.rfft(u)[used]

    def answer(output: str) -> Signal:
        h = structure.response(w[used], speed, output, filters)
        spectrum = np.zeros(w.size, dtype=complex)
        spectrum[used] = _measured(h, w[used], output) * x
        return Signal(t, np.fft.irfft(spectrum, u.size)[: t.size], "", f"{structure.name} model")

    return {output: answer(output) for output in outputs}


def _returning(u: Array) -> Array:
    """The input from rest, followed by a soft return to rest, so that it may be repeated for ever."""
    fade = int(REST / 2 * RATE)
    back = (u[-1] - u[0]) * (0.5 + 0.5 * np.cos(np.pi * np.arange(1, fade + 1) / fade))
    return np.concatenate((u - u[0], back, np.zeros(fade)))


def _measured(h: Complex, w: Array, output: str) -> Complex:
    return h / (1j * w) if output == "vydot" else h
