"""Lateral tyre force of one axle, and its slip angle down to standstill."""

from __future__ import annotations

from math import atan, sin

LOW_SPEED = 0.3
"""Below this rolling speed [m/s] the slip is taken at this speed: the force fades into a viscous one."""


def slip_angle(forward: float, leftward: float) -> float:
    """Slip angle [rad] from the wheel's own velocity [m/s] along and across its plane (left positive).

    Exactly atan(leftward / |forward|) above LOW_SPEED. Below, the denominator stays at LOW_SPEED, so that
    turning the wheels of a parked car makes no force and a creeping one has a finite pole.
    """
    rolling = forward if forward >= 0.0 else -forward
    return atan(leftward / (rolling if rolling > LOW_SPEED else LOW_SPEED))


def lateral_force(slip: float, stiffness: float, peak: float, shape: float) -> float:
    """Force [N] (left positive) at a slip angle [rad]: -D sin(c atan(C slip/(c D))).

    Pacejka's Magic Formula without curvature term ("Tire and Vehicle Dynamics", eq. 4.49, E = 0):
    slope -C = -`stiffness` [N/rad] at zero slip, at most D = `peak` [N], factor c = `shape` (1.3 usual).
    """
    return -peak * sin(shape * atan(stiffness * slip / (shape * peak)))
