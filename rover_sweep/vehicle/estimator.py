"""Whether the EKF estimates velocity and position (EKF_STATUS_REPORT)."""

from __future__ import annotations

from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.link.mavlink import constant


def has_position(flags: int) -> bool:
    """Whether horizontal velocity and absolute position are estimated. flags: EKF_STATUS_FLAGS."""
    wanted = constant("EKF_VELOCITY_HORIZ") | constant("EKF_POS_HORIZ_ABS")
    return flags & wanted == wanted and not flags & constant("EKF_CONST_POS_MODE")


def estimator_ready(link: Link) -> bool:
    """Ask the vehicle; False also if it does not answer."""
    report = link.request_message("EKF_STATUS_REPORT")
    return report is not None and has_position(int(report.flags))
