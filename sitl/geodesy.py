"""Where on Earth the embedded rover drives: a flat patch around ArduPilot's usual SITL home."""

from __future__ import annotations

from math import cos, radians

ORIGIN = (-35.363262, 149.165237, 584.0)  # latitude, longitude [deg], altitude [m] of the plant's start
METRES_PER_DEGREE = 111318.84502145034  # as ArduPilot's Location


def latitude_longitude(north: float, east: float) -> tuple[float, float]:
    """Degrees of a place `north` and `east` [m] of the origin."""
    latitude = ORIGIN[0] + north / METRES_PER_DEGREE
    return latitude, ORIGIN[1] + east / (METRES_PER_DEGREE * cos(radians(latitude)))
