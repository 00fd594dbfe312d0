"""Heartbeats as bytes, of any system."""

from __future__ import annotations

from pymavlink.dialects.v20 import ardupilotmega as m


def heartbeat(system: int, autopilot: int = m.MAV_AUTOPILOT_ARDUPILOTMEGA, component: int = 1) -> bytes:
    """A frame of a ground rover."""
    mav = m.MAVLink(None, srcSystem=system, srcComponent=component)
    return bytes(m.MAVLink_heartbeat_message(m.MAV_TYPE_GROUND_ROVER, autopilot, 0, 0, 4, 3).pack(mav))
