"""From which ground stations a rover accepts overrides, by its parameters. Pure.

Up to 4.6 only from SYSID_MYGCS (Rover-4.6.3 GCS_Common.cpp, handle_rc_channels_override). From 4.7 on that
parameter is called MAV_GCS_SYSID. If MAV_GCS_SYSID_HI is at least as large, all ids between the two count
(GCS::sysid_is_gcs of 4.8-dev).
"""

from __future__ import annotations

from collections.abc import Mapping

from rover_sweep.vehicle.link.mavlink import GCS_SYSTEM

OLD_NAME = "SYSID_MYGCS"
NEW_NAMES = ("MAV_GCS_SYSID", "MAV_GCS_SYSID_HI")


def why_overrides_ignored(have: Mapping[str, float]) -> str:
    """A sentence if the rover would ignore the overrides of this program, else ''.

    have: parameters by name; missing ones count as their defaults (255, no range).
    """
    name = NEW_NAMES[0] if NEW_NAMES[0] in have else OLD_NAME
    low = have.get(name, float(GCS_SYSTEM))
    high = max(low, have.get(NEW_NAMES[1], 0.0))
    if low <= GCS_SYSTEM <= high:
        return ""
    setting = f"{name} is {low:g}" if high == low else f"{name} is {low:g} and {NEW_NAMES[1]} {high:g}"
    return (
        f"{setting}: the rover ignores overrides of other ground stations; this one is {GCS_SYSTEM}, "
        f"set {name} to {GCS_SYSTEM}"
    )
