"""Arming the official firmware for a drive of a test or benchmark."""

from __future__ import annotations

import sys

from rover_sweep.vehicle.identity import estimator_ready
from rover_sweep.vehicle.link.link import Link, Refused
from rover_sweep.vehicle.run.controls import pump

READY_S = 120.0


def arm_in_mode(link: Link, mode: int, name: str, arm_first: bool = False) -> None:
    """In this mode (custom_mode) and armed, once the estimator is ready; AssertionError after `READY_S`.

    arm_first: for a mode that drives off as soon as it is entered armed.
    """
    steps = [
        (f"go into {name}", "MAV_CMD_DO_SET_MODE", 1.0, float(mode)),
        ("arm", "MAV_CMD_COMPONENT_ARM_DISARM", 1.0),
    ]
    started = link.clock.now
    while link.clock.now - started < READY_S:
        if estimator_ready(link):
            try:
                for step in reversed(steps) if arm_first else steps:
                    link.require(*step)
                return
            except Refused as refused:
                print(f"  {refused}", file=sys.stderr)
        pump(link, 2.0, 10.0)
    raise AssertionError(f"the rover did not arm within {READY_S:g} s")
