"""Input of the speed gains: the law of the speed as `speed.json` holds it."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rover_sweep.data.recording import Array

BATTERY = 0.1  # relative change of the gain between a full and an empty battery, either way


@dataclass(frozen=True)
class SpeedPlant:
    """T v' = K (u(t - tau) - u0) - v: gain [m/s per full throttle], lag, delay [s], offset (share of full),
    of which dead_zone is the motor controller's and the rest is drag."""

    gain: float
    lag: float
    delay: float
    offset: float
    dead_zone: float = 0.0

    def response(self, w: Array, period: float) -> NDArray[np.complex128]:
        """Frequency response (n,) at w (n,) rad/s of the plant behind a throttle held for a period [s]."""
        z, a = np.exp(1j * w * period), np.exp(-period / self.lag)
        return np.asarray(self.gain * (1 - a) / (z - a) * np.exp(-1j * w * self.delay))


@dataclass(frozen=True)
class IdentifiedSpeed:
    """plant; intervals: 90 % {name: (low, high)}; level, reasons: verdict of the identification; speeds:
    (lowest, mean, highest) [m/s]; band: usable [rad/s]; residual: of the speed [m/s rms]; coasting:
    deceleration at neutral [m/s^2] and the speed there [m/s], None if not recorded; parameters: of
    the autopilot in the runs; dead_zone_from: lower end of its interval (share of full), 0 if unknown."""

    plant: SpeedPlant | None
    intervals: Mapping[str, tuple[float, float]]
    level: str
    reasons: tuple[str, ...]
    speeds: tuple[float, float, float]
    band: tuple[float, float] | None
    residual: float
    coasting: tuple[float, float] | None
    parameters: Mapping[str, float]
    dead_zone_from: float = 0.0

    def family(self) -> Iterator[SpeedPlant]:
        """The plant, and the corners of the intervals of gain (with the battery's state), lag and delay."""
        assert self.plant is not None
        yield self.plant
        gain, lag, delay = (self.intervals[name] for name in ("gain", "lag", "delay"))
        gains = (gain[0] * (1 - BATTERY), gain[1] * (1 + BATTERY))
        for k, t, tau in itertools.product(gains, lag, delay):
            yield replace(self.plant, gain=k, lag=t, delay=tau)


def speed_from_document(document: Mapping[str, Any]) -> IdentifiedSpeed:
    """From the document of speed.json; KeyError, TypeError or ValueError for a damaged one."""
    law, coasting = document["law"], document["coasting"]
    plant = None
    if law is not None:
        zone = (coasting or {}).get("dead_zone")
        offset = float(law["offset"])
        kept = min(max(float(zone), 0.0), max(offset, 0.0)) if zone is not None else 0.0
        plant = SpeedPlant(float(law["gain_m_s"]), float(law["lag_s"]), float(law["delay_s"]), offset, kept)
    low, mean, high = document["speeds_m_s"]
    return IdentifiedSpeed(
        plant,
        {name: (float(ends[0]), float(ends[1])) for name, ends in document["intervals"].items()},
        str(document["level"]),
        tuple(document["reasons"]),
        (float(low), float(mean), float(high)),
        tuple(document["band_rad_s"]) if document["band_rad_s"] else None,
        float(document["residual_m_s"] or 0.0),
        (float(coasting["deceleration_m_s2"]), float(coasting["speed_m_s"])) if coasting else None,
        {name: float(value) for name, value in document["parameters"].items()},
        float(((coasting or {}).get("dead_zone_interval") or (0.0,))[0]),
    )
