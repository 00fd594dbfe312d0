"""Brings a rover to what identification needs: parameters, applet, and the reboots in between.

It can be interrupted anywhere and begun again. A parameter that was set before the interruption reads as
right but does not count until the reboot, which is therefore asked of the firmware's behaviour: it
denies a stream that only the new loop rate allows, and refuses to restart scripts.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Sequence
from pathlib import Path

from firmware_params.param_files import WantedParameter, compare
from rover_sweep.errors import LinkError
from rover_sweep.vehicle.events import Event, Notice, ParameterSet, Rebooting
from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.link.requests import Refused
from rover_sweep.vehicle.link.streams import fastest_interval_ms, grants
from rover_sweep.vehicle.parameters.read_write import read_present, write
from rover_sweep.vehicle.setup.applet_upload import await_applet, reboot, restart_scripts, upload

Consent = Callable[[tuple[str, ...]], bool]  # may the rover be rebooted, for these reasons?
_FACTORY_RATE = 50  # Hz, SCHED_LOOP_RATE as it comes
_SCRIPTS_START = 20.0  # s after boot within which scripts begin to run


def always(because: tuple[str, ...]) -> bool:
    """Consent to every reboot."""
    return True


def refuse_armed(link: Link) -> None:
    """LinkError on an armed rover, before anything of it is set."""
    if link.armed:
        raise LinkError("the rover is armed; disarm it first: an armed rover is neither set up nor rebooted")


def install(
    link: Link,
    parameters: Sequence[WantedParameter],
    applet: Path | None,
    replace: bool = False,
    may_reboot: Consent = always,
) -> Iterator[Event]:
    """Set the parameters that differ, and bring the applet onto a rover that does not run it.

    replace: copy the applet even over one that runs. At most three reboots, each only with consent;
    without it a Notice says what does not count yet. LinkError while armed.
    """
    refuse_armed(link)
    rebooted = False
    for _ in range(2):  # scripting's own parameters may appear only after scripting was switched on
        because, missing = yield from _set(link, parameters)
        because = because or (() if rebooted else _set_but_not_booted(link, parameters))
        if not because:
            break
        if not may_reboot(because):
            yield Notice("warning", f"{', '.join(because)} will count after a reboot")
            break
        yield Rebooting(because)
        reboot(link)
        rebooted = True
    for sentence in missing:
        yield Notice("warning", sentence)
    if applet is None:
        return
    patience = _SCRIPTS_START if rebooted or link.clock.now < _SCRIPTS_START else 0.0
    if replace or not await_applet(link, patience):
        yield from _bring_applet(link, applet, may_reboot)


def _set(
    link: Link, parameters: Sequence[WantedParameter]
) -> Generator[Event, None, tuple[tuple[str, ...], tuple[str, ...]]]:
    """Writes what differs; returns (names that need a reboot, sentences on those that are not there)."""
    because, missing = [], []
    for difference in compare(read_present(link, [p.name for p in parameters]), parameters):
        if difference.found is None:
            missing.append(difference.sentence)
            continue
        written = write(link, difference.name, difference.wanted)
        yield ParameterSet(written.name, written.old, written.value, difference.needs_reboot)
        because += [difference.name] if difference.needs_reboot else []
    return tuple(because), tuple(missing)


def _set_but_not_booted(link: Link, parameters: Sequence[WantedParameter]) -> tuple[str, ...]:
    """SCHED_LOOP_RATE where the loop does not run at it yet. A higher one than 50 Hz is told from it by a
    stream that is denied at 50 Hz (see `streams`)."""
    wanted = next((p for p in parameters if p.name == "SCHED_LOOP_RATE" and p.needs_reboot), None)
    has = read_present(link, [wanted.name]) if wanted else {}
    if (
        not has
        or wanted is None
        or fastest_interval_ms(has[wanted.name]) >= fastest_interval_ms(_FACTORY_RATE)
    ):
        return ()
    return () if grants(link, "SYSTEM_TIME", has[wanted.name]) else (wanted.name,)


def _bring_applet(link: Link, applet: Path, may_reboot: Consent) -> Iterator[Event]:
    place = upload(link, applet)
    yield Notice("info", f"the applet was copied to {place}")
    try:
        restart_scripts(link)
        because = applet.name
    except Refused:
        because = "SCR_ENABLE"
    if because == applet.name and await_applet(link):
        return
    if not may_reboot((because,)):
        yield Notice("warning", "the applet will run after a reboot")
        return
    yield Rebooting((because,))
    reboot(link)
    await_applet(link)
