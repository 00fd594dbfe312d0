"""How a run ended: by the applet's report if it was heard, else by the reason why we stopped."""

from __future__ import annotations

from rover_sweep.errors import LinkError
from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.run.follow import Follower
from rover_sweep.vehicle.run.right_to_move import RightToMove

_REPORTS = 3.0  # s: an idle applet reports its last completed run once a second
_LOST = 1.5  # s without a message
_OF_OUR_SWITCH = "switch low"
_NOT_RECEIVED = "the rover did not receive our override of the switch, which fell low"


def hear_outcome(
    link: Link, follower: Follower, right: RightToMove, name: str, failures: list[str], holds_switch: bool
) -> tuple[bool, str]:
    """(completed, reason). LinkError, with `failures` as its notes, if the rover is not heard.

    holds_switch: we override the switch.
    """
    if right.lost and right.silence > _LOST:
        raise cut_off(right, name, failures)
    _wait(link, follower)
    completed, reason = follower.outcome
    if completed or (follower.outcome_heard and reason != _OF_OUR_SWITCH):
        return completed, reason
    return False, right.lost or (_NOT_RECEIVED if holds_switch else reason)


def cut_off(right: RightToMove, name: str, failures: list[str]) -> LinkError:
    error = LinkError(
        f"{name} was stopped: {right.lost}, and the rover is still silent; check its power, the radio's "
        "range and the cable. The rover's log shows what it did since"
    )
    for failure in failures:
        error.add_note(failure)
    return error


def _wait(link: Link, follower: Follower) -> None:
    started, deadline = link.clock.now, link.line.monotonic() + _REPORTS
    while not follower.outcome_heard and link.clock.now - started < _REPORTS:
        if link.line.monotonic() > deadline:
            return
        link.receive(0.1)
