"""Values read from a rover before a run. The checks judge these values and read nothing.

NaN: the vehicle does not report it. None: the message did not arrive.
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
    """SYS_STATUS, BATTERY_STATUS. volts [V]; remaining: share of the capacity, 0..1."""

    volts: float = nan
    remaining: float = nan


@dataclass(frozen=True)
class Gps:
    """GPS_RAW_INT. fix: GPS_FIX_TYPE (3: 3D fix); hdop: horizontal dilution of precision [-]."""

    fix: int
    satellites: int
    hdop: float = nan


@dataclass(frozen=True)
class Estimator:
    """EKF_STATUS_REPORT. flags: EKF_STATUS_FLAGS; worst: largest variance of velocity, position and compass
    (1: the limit of the innovation test)."""

    flags: int
    worst: float = 0.0


@dataclass(frozen=True)
class ClockComparison:
    """Time stamps of messages against their arrival, over `span` s of the vehicle's clock.

    rate: seconds of the vehicle's clock per second of ours. jitter: delay after the earliest message [s],
    95th percentile. drift: of our clock against the vehicle's [s/s]; bound: its uncertainty from the jitter.
    behind_utc: this computer's UTC minus GPS time [s]. offset: arrival minus the vehicle's clock [s], of the
    earliest message.
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
    """All observed values. w_max: top frequency of the planned sweep [rad/s]. channels: PWM of RC_CHANNELS by
    number [us], empty without a receiver; a receiver that lost its radio keeps the last values. radio,
    logging: whether the firmware reports that it hears the radio, that it can log. pending: parameters that
    were set and wait for a reboot. disk: (free bytes, name) of the folder. link: quality of the link during
    the reading."""

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
        """A parameter of the rover, NaN if the rover does not have it."""
        return self.parameters.get(name, nan)
