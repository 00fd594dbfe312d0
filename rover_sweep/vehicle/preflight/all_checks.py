"""`preflight`: all checks before a run. `remedy`: correct what one check found.

    checks = preflight(link, folder)
    for event in remedy(link, checks[1], reboot=True): ...

`preflight` changes nothing on the vehicle. `remedy` moves and arms nothing. On an armed rover it only
disarms. It reboots only with reboot=True; otherwise it sets the parameters, notes that they wait for a
reboot (`setup.pending_reboot`), and the next preflight in that folder asks for the reboot.
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
"""Names of all checks, in the order in which to correct them."""


def preflight(link: Link, folder: Path, w_max: float | None = None) -> tuple[Check, ...]:
    """All checks, in the order in which to correct them.

    folder: where runs will be recorded. w_max: top frequency of the planned sweep [rad/s]; if not given, the
    applet's (SWP_WMAX). An unsupported vehicle gets only the check `firmware`, a link that is too poor to
    conclude anything only the check `link`. LinkError when the link is lost.
    """
    try:
        return all_checks(look(link, folder, w_max)) if (other := _other(link)) is None else (other,)
    except BadLink as error:
        return (Check("link", "bad", "too poor", str(error), Remedy(ADVICE, by_hand=True)),)


def _other(link: Link) -> Check | None:
    """The check `firmware` for an unsupported vehicle; None for an ArduPilot Rover."""
    try:
        identify_vehicle(link)
    except BadLink:
        raise
    except LinkError as error:
        link.receive(1.0)  # raises if the link is gone
        hand = Remedy("connect an ArduPilot Rover", by_hand=True)
        return Check("firmware", "bad", "not usable", str(error), hand)
    return None


def all_checks(observed: Observation) -> tuple[Check, ...]:
    """All checks on observed values. Pure."""
    return tuple(check(observed) for check in _IN_ORDER)


def remedy(link: Link, check: Check, reboot: bool, folder: Path | None = None) -> Iterator[Event]:
    """Carry out the remedy of `check`; run `preflight` again to see whether it helped.

    folder: that of the preflight; by default the folder that the link records into. UsageError if only a
    person can do it, LinkError if the vehicle refuses.
    """
    return remedies.carry_out(link, check, reboot, folder or link.tlog.parent)
