"""Prepares a rover for identification: sets parameters, installs the applet, reboots in between.

It can be interrupted anywhere and repeated. A parameter that was set before the interruption reads as
correct but takes effect only after the reboot. The firmware's behaviour shows whether the reboot is missing:
it denies a stream that only the new loop rate allows, and refuses to restart scripts.
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
from rover_sweep.vehicle.parameters.read_write import read_present, write_parameter
from rover_sweep.vehicle.setup.applet_upload import await_applet, reboot, restart_scripts, upload

Consent = Callable[[tuple[str, ...]], bool]  # whether the rover may be rebooted, for these reasons
_FACTORY_RATE = 50  # Hz, default of SCHED_LOOP_RATE
_SCRIPTS_START = 20.0  # s after boot within which scripts start


def always(because: tuple[str, ...]) -> bool:
    """Consent to every reboot."""
    return True


def refuse_armed(link: Link) -> None:
    """LinkError on an armed rover, before anything is set."""
    if link.armed:
        raise LinkError(
            "the rover is armed; disarm it first: this program does not set up or reboot an armed rover"
        )


def install(
    link: Link,
    parameters: Sequence[WantedParameter],
    applet: Path | None,
    replace: bool = False,
    may_reboot: Consent = always,
) -> Iterator[Event]:
    """Set the parameters that differ, and copy the applet to a rover that does not run it.

    replace: copy the applet even if one runs. At most three reboots, each only with consent; without it a
    Notice names what takes effect after a reboot. LinkError while armed.
    """
    refuse_armed(link)
    rebooted = False
    for _ in range(2):  # scripting's own parameters may appear only after scripting was switched on
        because, missing = yield from _set(link, parameters)
        because = because or (() if rebooted else _set_but_not_booted(link, parameters))
        if not because:
            break
        if not may_reboot(because):
            yield Notice("warning", f"{', '.join(because)} will take effect after a reboot")
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
        yield from _copy_applet(link, applet, may_reboot)


def _set(
    link: Link, parameters: Sequence[WantedParameter]
) -> Generator[Event, None, tuple[tuple[str, ...], tuple[str, ...]]]:
    """Write the differences; returns (names that need a reboot, sentences on missing parameters)."""
    because, missing = [], []
    for difference in compare(read_present(link, [p.name for p in parameters]), parameters):
        if difference.found is None:
            missing.append(difference.sentence)
            continue
        written = write_parameter(link, difference.name, difference.wanted)
        yield ParameterSet(written.name, written.old, written.value, difference.needs_reboot)
        because += [difference.name] if difference.needs_reboot else []
    return tuple(because), tuple(missing)


def _set_but_not_booted(link: Link, parameters: Sequence[WantedParameter]) -> tuple[str, ...]:
    """SCHED_LOOP_RATE if the loop does not run at that rate yet. At 50 Hz the firmware denies a stream that
    it grants at a higher loop rate (see `streams`)."""
    wanted = next((p for p in parameters if p.name == "SCHED_LOOP_RATE" and p.needs_reboot), None)
    has = read_present(link, [wanted.name]) if wanted else {}
    if (
        not has
        or wanted is None
        or fastest_interval_ms(has[wanted.name]) >= fastest_interval_ms(_FACTORY_RATE)
    ):
        return ()
    return () if grants(link, "SYSTEM_TIME", has[wanted.name]) else (wanted.name,)


def _copy_applet(link: Link, applet: Path, may_reboot: Consent) -> Iterator[Event]:
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
        yield Notice("warning", "the applet will start after a reboot")
        return
    yield Rebooting((because,))
    reboot(link)
    await_applet(link)
