"""`preflight`: everything that must be right before a run. `remedy`: put one of it right, with one key.

    checks = preflight(link, folder)
    for event in remedy(link, checks[1], reboot=True): ...

`preflight` changes nothing on the vehicle. `remedy` moves and arms nothing; it refuses all but disarming
on an armed rover, and reboots only with reboot=True. Without it what needs one is set and noted
(`vehicle.pending`), and the next preflight in that folder asks for the reboot alone.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from rover_sweep.errors import LinkError
from rover_sweep.vehicle.events import Event
from rover_sweep.vehicle.identity import identify_vehicle
from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.link.link_quality import ADVICE, BadLink
from rover_sweep.vehicle.preflight import (
    disk,
    onboard,
    radio_check,
    rates,
    readiness,
    recording_source,
    remedies,
)
from rover_sweep.vehicle.preflight.item import Check, Remedy
from rover_sweep.vehicle.preflight.link_check import link as link_check
from rover_sweep.vehicle.preflight.observed import Observation
from rover_sweep.vehicle.preflight.read_rover import look

_IN_ORDER = (
    *(readiness.armed, onboard.firmware, onboard.parameters, onboard.applet),
    *(rates.loop_rate, rates.filters, link_check, rates.streams, rates.clock),
    *(onboard.logging, recording_source.source, disk.disk),
    *(readiness.battery, readiness.gps, readiness.ekf, radio_check.rc, radio_check.switch, readiness.mode),
)
NAMES = tuple(check.__name__ for check in _IN_ORDER)
"""Names of all checks, in the order in which they are to be put right."""


def preflight(link: Link, folder: Path, w_max: float | None = None) -> tuple[Check, ...]:
    """All checks, in the order in which they are to be put right.

    folder: where runs will be recorded. w_max: top of the sweep to come [rad/s], the applet's own if not
    given. A vehicle that is none of ours gets the check `firmware` alone, a link over which nothing can be
    concluded the check `link`. LinkError when the link is lost.
    """
    try:
        return judged(look(link, folder, w_max)) if (other := _other(link)) is None else (other,)
    except BadLink as error:
        return (Check("link", "bad", "too poor", str(error), Remedy(ADVICE, by_hand=True)),)


def _other(link: Link) -> Check | None:
    """What is to be said of a vehicle that is none of ours."""
    try:
        identify_vehicle(link)
    except BadLink:
        raise
    except LinkError as error:
        link.receive(1.0)  # a link that is gone says so itself
        hand = Remedy("connect an ArduPilot Rover", by_hand=True)
        return Check("firmware", "bad", "not usable", str(error), hand)
    return None


def judged(seen: Observation) -> tuple[Check, ...]:
    """The checks on what was seen: pure."""
    return tuple(check(seen) for check in _IN_ORDER)


def remedy(link: Link, check: Check, reboot: bool, folder: Path | None = None) -> Iterator[Event]:
    """Do what `check` offers; `preflight` then tells whether it helped.

    folder: that of the preflight, by default the one that the link records into. UsageError for what
    only a person can do, LinkError where the vehicle refuses.
    """
    return remedies.carry_out(link, check, reboot, folder or link.tlog.parent)
