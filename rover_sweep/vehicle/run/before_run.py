"""Conditions before the rover is armed and its switch thrown, and the number that allows one run."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

from firmware_params.applet_parameters import STATES
from rover_sweep.errors import LinkError, UsageError
from rover_sweep.vehicle.events import Event, Notice
from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.link.link_quality import BadLink
from rover_sweep.vehicle.parameters.read_write import read_parameter, write_parameter
from rover_sweep.vehicle.run.follow import Follower
from rover_sweep.vehicle.run.settings import RunSettings

_REPORTS = 5.0  # s of the vehicle's clock; an idle applet reports once a second
_TOO_LATE, _TOO_LOSSY = 1.0, 0.35  # s from a request to its answer; share of the frames
_AT_REST, _COMES_TO_REST = 0.5, 20.0  # m/s; s
_STOPPED, _NUMBERS = 10, 65535


def refuse_blind(present: Mapping[str, float], settings: RunSettings) -> None:
    """UsageError if we would drive a rover that does not detect the loss of its transmitter.

    With FS_THR_ENABLE 0 the firmware sets no failsafe (Rover/radio.cpp, 4.6.3): SYS_STATUS reports a healthy
    receiver, and the applet's rc:has_valid_input stays true.
    """
    if settings.throttle_us is not None and present.get("FS_THR_ENABLE") == 0:
        raise UsageError(
            "FS_THR_ENABLE is 0: the rover would not detect the loss of the safety pilot's transmitter; "
            "set FS_THR_ENABLE to 1, or let the pilot drive (no --throttle)"
        )


def catch_up(link: Link) -> None:
    """Process the messages that arrived while nobody read, for example while the user was asked."""
    while link.receive(0.0) is not None:
        pass


def await_rest(link: Link, follower: Follower, settings: RunSettings) -> Iterator[Event]:
    """Wait, if we throw the switch or drive, until the applet is idle and the rover is at rest.

    LinkError if the link is too poor to drive over, if the applet does not report or is in a run, or if the
    rover does not come to rest.
    """
    if settings.trigger == "pilot" and settings.throttle_us is None:
        return
    _refuse_poor(link, settings)
    started, asked = link.clock.now, False
    while waits_for := _not_at_rest(follower, settings):
        waited = link.clock.now - started
        if waited > (_COMES_TO_REST if follower.reports else _REPORTS):
            raise LinkError(waits_for)
        if waited > _REPORTS and not asked:
            asked = True
            yield Notice("info", f"the run has not started yet: {waits_for}")
        link.receive(0.1)
        yield from follower.take()


def _refuse_poor(link: Link, settings: RunSettings) -> None:
    """BadLink if we would drive over a link that is too slow or too lossy to stop the rover in time."""
    quality = link.quality
    late = quality.latency is not None and quality.latency > _TOO_LATE
    if settings.throttle_us is not None and (late or quality.lost > _TOO_LOSSY):
        raise BadLink(f"the rover is not driven over this link: {quality.words}")


def _not_at_rest(follower: Follower, settings: RunSettings) -> str:
    if not follower.reports:
        return "the applet does not report its state (SWP_ST); look for script errors in the rover's messages"
    if follower.state not in (0, _STOPPED):
        state = STATES.get(follower.state, f"state {follower.state}")
        return f"the applet is already in a run ({state}); throw its switch low and start again"
    if settings.throttle_us is None:
        return ""
    if math.isnan(follower.speed):
        return "the rover does not send its speed (LOCAL_POSITION_NED); does its EKF have a position?"
    if follower.speed > _AT_REST:
        return f"the rover moves at {follower.speed:.1f} m/s; it must be at rest before the run"
    return ""


def write_go(link: Link) -> None:
    """Allow the applet one run, by a new value of SWP_GO."""
    write_parameter(link, "SWP_GO", float(int(read_parameter(link, "SWP_GO")) % _NUMBERS + 1))
