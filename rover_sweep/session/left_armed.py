"""A rover that a run left armed: whether this session did it, and stopping and disarming it afterwards."""

from __future__ import annotations

from collections.abc import Iterator

from rover_sweep.errors import LinkError
from rover_sweep.session.content import Content
from rover_sweep.vehicle.events import Event, Notice
from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.parameters.override_time import LAPSE, SHORT
from rover_sweep.vehicle.parameters.read_write import read_present
from rover_sweep.vehicle.run.controls import ARM, AUX, FORCE, SCRIPTING_1

_SAME_DRIVE = 600.0  # s of the vehicle's clock after which somebody else is taken to have armed it


def armed_by_last_run(content: Content, now: float) -> bool:
    """Whether an armed rover was armed by this program for its last run, which it could not end.

    now: time since the vehicle's boot [s].
    """
    last = content.runs[-1] if content.runs else None
    if last is None or not last.left_armed:
        return False
    return last.span is None or 0 <= now - last.span[1] < _SAME_DRIVE


def let_go_late(link: Link, disarm: bool) -> Iterator[Event]:
    """Stop the applet and, if `disarm`, disarm the rover; never starts anything."""
    if link.command(AUX, float(SCRIPTING_1), 0.0) != 0:
        yield Notice("warning", "this program could not stop the applet: throw the switch low")
    if not (disarm and link.armed):
        return
    if link.command(ARM, 0.0) != 0:
        link.command(ARM, 0.0, FORCE)
    link.wait_for("HEARTBEAT", 3.0, lambda _: not link.armed)
    if link.armed:
        raise LinkError("the rover is armed and this program cannot disarm it; disarm it by hand")
    yield Notice("warning", "the rover was still armed from the run that was cut short, and was disarmed")


def disarm_left_armed(link: Link, content: Content) -> Iterator[Event]:
    """Stop and disarm a rover that the last run of this session left armed; otherwise do nothing."""
    if link.armed and not link.clock.known:
        link.request_message("SYSTEM_TIME")  # its clock shows how old the last run is
    if link.armed and armed_by_last_run(content, link.clock.now):
        let_go = list(let_go_late(link, disarm=True))
        if read_present(link, [LAPSE]).get(LAPSE) == SHORT[LAPSE]:
            words = f"{LAPSE} is {SHORT[LAPSE]:g} s, perhaps from the interrupted run; the default is 3 s"
            yield Notice("warning", words)
        yield from let_go
