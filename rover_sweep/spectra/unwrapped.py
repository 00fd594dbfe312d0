"""The phase of a response as it is drawn."""

from __future__ import annotations

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.spectra.response import FrequencyResponse
from rover_sweep.spectra.windowed import Complex


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
