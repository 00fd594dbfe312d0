"""What was read from a rover before a run, as plain values: the checks judge these and read nothing.

NaN: the vehicle does not tell. None: the message did not come.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import nan

from rover_sweep.vehicle.link.link_quality import LinkQuality
from rover_sweep.vehicle.link.streams import Stream, StreamQuality
from rover_sweep.vehicle.setup.survey import Survey


@dataclass(frozen=True)
class Battery:
    """SYS_STATUS, BATTERY_STATUS. volts; remaining: 0..1."""

    volts: float = nan
    remaining: float = nan


@dataclass(frozen=True)
class Gps:
    """GPS_RAW_INT. fix: GPS_FIX_TYPE (3: three dimensions); hdop: of one."""

    fix: int
    satellites: int
    hdop: float = nan


@dataclass(frozen=True)
class Estimator:
    """EKF_STATUS_REPORT. flags: EKF_STATUS_FLAGS; variances: the worst of speed, position, compass (1: the
    limit of the innovation test)."""

    flags: int
    worst: float = 0.0


@dataclass(frozen=True)
class ClockComparison:
    """Time stamps of messages against their arrival, over `span` s of the vehicle's clock.

    rate: seconds of the vehicle in a second here. jitter: s by which messages come later than the
    quickest did, 95th percentile. drift: s per s, and its bound, what the jitter leaves open. behind_utc:
    the laptop's clock against the GPS's, s, positive where the laptop is ahead. offset: of the arrival's
    clock from the vehicle's, s, by the quickest message.
    """

    span: float
    rate: float
    jitter: float
    drift: float
    bound: float
    behind_utc: float = nan
    offset: float = nan


@dataclass(frozen=True)
class Observation:
    """Everything at once. w_max: top of the sweep to come [rad/s]. channels: PWM of RC_CHANNELS by number,
    empty without a receiver; a receiver that lost its radio keeps the last ones. radio, logging: the
    firmware's own word that it hears the radio, that it can log. pending: parameters that were set and wait
    for a reboot. disk: bytes free in the folder, and its name. link: how good the link was meanwhile."""

    survey: Survey
    parameters: Mapping[str, float]
    w_max: float
    armed: bool
    mode: int
    streams: tuple[Stream, ...] = ()
    quality: tuple[StreamQuality, ...] = ()
    clock: ClockComparison | None = None
    battery: Battery | None = None
    gps: Gps | None = None
    estimator: Estimator | None = None
    channels: Mapping[int, int] | None = None
    radio: bool | None = None
    logging: bool | None = None
    pending: tuple[str, ...] = ()
    disk: tuple[int, str] = (0, "")
    link: LinkQuality | None = None

    def parameter(self, name: str) -> float:
        """A parameter of the rover, NaN where it has none."""
        return self.parameters.get(name, nan)
