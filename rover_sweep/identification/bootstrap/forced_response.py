"""The response of a model to the measured steering, computed in the frequency domain without step size."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from rover_sweep.data.recording import Array, LowPass, Signal
from rover_sweep.identification.structure.state_space import ModelStructure
from rover_sweep.spectra.windowed import Complex

RATE = 1000.0  # Hz, of the output; other times are interpolated
TOP = 8.0  # of w_max: higher frequencies do not affect the band
RETURN_TIME = 10.0  # s after the run, in which the steering returns to its start and the response decays


def forced_response(
    structure: ModelStructure,
    speed: float,
    delta: Signal,
    span: tuple[float, float],
    outputs: Sequence[str],
    w_max: float,
    filters: Mapping[str, LowPass],
) -> dict[str, Signal]:
    """Outputs {output: signal (n,)} at 1 kHz over `span` (start, end) [s], up to a constant.

    y = IFFT(H(w) FFT(delta)), up to 8 w_max [rad/s]. delta [rad] is assumed constant before the run. vydot
    is returned as its integral V_y [m/s], the measured channel. There is no delay from a step size or a held
    input, and an unstable model gives the bounded response of its frequency response.
    """
    start, end = span
    t = start + np.arange(int((end - start) * RATE) + 1) / RATE
    u = _with_smooth_return(delta.on(t))
    w = np.asarray(2 * np.pi * np.fft.rfftfreq(u.size, 1 / RATE), dtype=np.float64)
    used = np.flatnonzero((w > 0) & (w <= TOP * w_max))
    x = np.fft.rfft(u)[used]

    def simulated(output: str) -> Signal:
        h = structure.response(w[used], speed, output, filters)
        spectrum = np.zeros(w.size, dtype=complex)
        spectrum[used] = _measured(h, w[used], output) * x
        return Signal(t, np.fft.irfft(spectrum, u.size)[: t.size], "", f"{structure.name} model")

    return {output: simulated(output) for output in outputs}


def _with_smooth_return(u: Array) -> Array:
    """The input (n,) minus its start, extended by a smooth return to zero: periodic without a jump."""
    fade = int(RETURN_TIME / 2 * RATE)
    back = (u[-1] - u[0]) * (0.5 + 0.5 * np.cos(np.pi * np.arange(1, fade + 1) / fade))
    return np.concatenate((u - u[0], back, np.zeros(fade)))


def _measured(h: Complex, w: Array, output: str) -> Complex:
    """The response (n_w,) of the measured channel: V_y for vydot."""
    return h / (1j * w) if output == "vydot" else h
