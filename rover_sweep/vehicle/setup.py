"""Prepares a rover for identification: sets parameters, installs the applet, reboots in between.

It can be interrupted anywhere and repeated. A parameter that was set before the interruption reads as
correct but takes effect only after the reboot. The firmware's behaviour shows whether the reboot is missing:
it denies a stream that only the new loop rate allows, and refuses to restart scripts.
"""

from __future__ import annotations

import dataclasses
import json
import math
import tempfile
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from firmware_params.applet_parameters import (
    PARAMETERS,
    applet_path,
    applet_source,
    applet_version,
    version_of,
)
from firmware_params.param_files import Difference, WantedParameter, compare
from rover_sweep.errors import LinkError
from rover_sweep.files.documents import read_json
from rover_sweep.vehicle.events import Event, Notice, Rebooting
from rover_sweep.vehicle.identity import AppletUnready, VehicleIdentity, identify_vehicle
from rover_sweep.vehicle.link.link import Link, Refused, crc32, remote_crc32
from rover_sweep.vehicle.link.mavlink import ftp_get, ftp_put
from rover_sweep.vehicle.link.recorded_transport import writing
from rover_sweep.vehicle.link.streams import fastest_interval_ms, grants
from rover_sweep.vehicle.logs import HOW_TO_DISARM, ParameterSource
from rover_sweep.vehicle.parameters import ParameterKept, read_present, write_parameter

# Copies the Lua applet to the vehicle by MAVLink FTP and starts it.


HARDWARE, SITL = "/APM/scripts", "scripts"  # folder of scripts on a flight controller, in SITL
_RESTART = 3.0  # SCRIPTING_CMD_STOP_AND_RESTART


@dataclass(frozen=True)
class AppletFile:
    """The applet's file on the vehicle. version: stated in its text, '' if none."""

    path: str
    version: str
    text: str


def read_applet(link: Link, name: str, ours: str = "") -> AppletFile | None:
    """Read the file `name` from the vehicle's script folder; None if it is missing, or without MAVLink FTP.

    ours: the text expected; if the checksum of the vehicle's file matches it, the file is not read.
    """
    for place in (HARDWARE, SITL) if ours else ():
        if remote_crc32(link, f"{place}/{name}") == crc32(ours.encode()):
            return AppletFile(f"{place}/{name}", version_of(ours), ours)
    with tempfile.TemporaryDirectory() as folder:
        local = Path(folder) / name
        for place in (HARDWARE, SITL):
            if not ftp_get(link, f"{place}/{name}", str(local)):
                text = local.read_text(encoding="utf-8", errors="replace")
                return AppletFile(f"{place}/{name}", version_of(text), text)
    return None


def _is_ours(present: Mapping[str, float]) -> bool:
    return math.isclose(present.get("SWP_VER", 0.0), applet_version(), rel_tol=1e-5)


def refuse_other_applet(link: Link, present: Mapping[str, float]) -> None:
    """AppletUnready unless this program's applet runs on the rover: its version, and the file's checksum.

    present: the applet's parameters.
    """
    if not _is_ours(present):
        version = f"{present['SWP_VER']:.7g}" if present.get("SWP_VER") else "of before 1.5"
        raise AppletUnready(f"the rover runs applet {version}, this program needs {applet_version():g}")
    wanted = crc32(applet_source().encode())
    name = applet_path().name
    found = [crc for place in (HARDWARE, SITL) if (crc := remote_crc32(link, f"{place}/{name}")) is not None]
    if not found:
        raise AppletUnready(
            f"the checksum of {name} on the rover cannot be read (MAVLink FTP), so it is not "
            "known which applet would steer",
            "`rover-sweep firmware install` copies it; or use a link that carries MAVLink FTP",
        )
    if wanted not in found:
        raise AppletUnready(f"{name} on the rover is not this program's (another checksum)")


def upload(link: Link, applet: Path, progress: Callable[[float], None] | None = None) -> str:
    """Copy the applet to the vehicle's script folder and return its path there. LinkError if that fails."""
    if link.armed:
        raise LinkError("the applet is not replaced while the rover is armed; disarm first")
    errors = []
    for folder in (HARDWARE, SITL):
        error = ftp_put(link, str(applet), f"{folder}/{applet.name}", progress)
        if not error:
            return f"{folder}/{applet.name}"
        errors.append(f"{folder}: {error}")
    raise LinkError(
        f"{applet.name} could not be copied to the vehicle ({'; '.join(errors)}); is there a card in it? "
        "You can also copy it to APM/scripts on the card by hand"
    )


def reboot(link: Link) -> None:
    """Reboot the vehicle and wait until it is back. LinkError while armed or when it does not return."""
    if link.armed:
        raise LinkError("the rover is not rebooted while it is armed; disarm first")
    link.request_message("SYSTEM_TIME")  # its clock shows the reboot
    while link.clock.now < 3.0 and link.receive(1.0) is not None:
        link.request_message("SYSTEM_TIME")
    link.require("reboot", "MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN", 1.0)
    link.reconnect()


def await_applet(link: Link, seconds: float = 15.0) -> bool:
    """Whether this program's version of the applet reports itself within `seconds` s of the vehicle's clock:
    scripts start some time after boot."""
    start = link.clock.now
    while not _is_ours(read_present(link, ["SWP_VER"])):
        link.forget(("PARAM_VALUE", "SWP_VER"))  # it does not exist yet
        link.request_message("SYSTEM_TIME")  # its clock, as no streams may be on
        if link.clock.now - start > seconds:
            return False
    return True


# Which parameters were set and wait for a reboot: a note in a folder, for the next run of this program.
#
# A parameter reads as set before it takes effect. ArduPilot increments STAT_BOOTCNT at each boot, which
# shows whether the reboot has happened since.


NOTE = "reboot-pending.json"


def waiting(folder: Path, vehicle: VehicleIdentity, boots: float) -> tuple[str, ...]:
    """Names noted for this vehicle in this boot (boots: STAT_BOOTCNT); () if it has rebooted since."""
    try:
        note = read_json((folder / NOTE).read_text(encoding="utf-8"))
        mine = note["vehicle"] == _key(vehicle) and note["boots"] == boots
        return tuple(map(str, note["names"])) if mine else ()
    except (OSError, ValueError, KeyError, TypeError):
        return ()


def note(folder: Path, vehicle: VehicleIdentity, boots: float, names: Iterable[str]) -> None:
    """Add names of parameters that wait for a reboot."""
    _keep(folder, vehicle, boots, dict.fromkeys((*waiting(folder, vehicle, boots), *names)))


def withdraw(folder: Path, vehicle: VehicleIdentity, boots: float, name: str) -> None:
    """Remove a name that was noted but then not set."""
    _keep(folder, vehicle, boots, [n for n in waiting(folder, vehicle, boots) if n != name])


def forget(folder: Path) -> None:
    """Delete the note, after the reboot."""
    (folder / NOTE).unlink(missing_ok=True)


def _keep(folder: Path, vehicle: VehicleIdentity, boots: float, names: Iterable[str]) -> None:
    if not (names := list(names)):
        forget(folder)
        return
    path = folder / NOTE
    partial = path.with_name(NOTE + ".part")
    content = {"vehicle": _key(vehicle), "boots": boots, "names": names}
    with writing(path):
        folder.mkdir(parents=True, exist_ok=True)
        partial.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
        partial.replace(path)


def _key(vehicle: VehicleIdentity) -> str:
    return f"{vehicle.uid} {vehicle.system} {vehicle.firmware} {vehicle.git_hash}"


Consent = Callable[[tuple[str, ...]], bool]  # whether the rover may be rebooted, for these reasons
_FACTORY_RATE = 50  # Hz, default of SCHED_LOOP_RATE
SCRIPTS_START = 20.0  # s after boot within which scripts start


def always(because: tuple[str, ...]) -> bool:
    """Consent to every reboot."""
    return True


def refuse_armed(link: Link) -> None:
    """LinkError on an armed rover, before anything is set."""
    if link.armed:
        raise LinkError(
            f"the rover is armed, and this program does not set up or reboot an armed rover. {HOW_TO_DISARM}"
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
    patience = SCRIPTS_START if rebooted or link.clock.now < SCRIPTS_START else 0.0
    if not replace and await_applet(link, patience):
        return
    waits_for = yield from copied_applet(link, applet)
    if waits_for and not may_reboot((waits_for,)):
        yield Notice("warning", "the applet will start after a reboot")
    elif waits_for:
        yield Rebooting((waits_for,))
        reboot(link)
        await_applet(link)


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
        yield dataclasses.replace(written, reboot=difference.needs_reboot)
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


def copied_applet(link: Link, applet: Path) -> Generator[Event, None, str]:
    """Copy the applet and start it; returns the name of what waits for a reboot, '' if the applet runs."""
    yield Notice("info", f"the applet was copied to {upload(link, applet)}")
    try:
        link.require("restart its scripts", "MAV_CMD_SCRIPTING", _RESTART)
    except Refused:  # scripting is off
        return "SCR_ENABLE"
    return "" if await_applet(link) else applet.name


# Whether a rover has the parameters and the applet that identification needs.


@dataclass(frozen=True)
class SurveyedParameter:
    """A wanted parameter and the rover's value; found is None if the rover does not have it."""

    wanted: WantedParameter
    found: float | None

    @property
    def fits(self) -> bool:
        return self.wanted.met_by(self.found)


@dataclass(frozen=True)
class AppletState:
    """file: on the rover, None if it cannot be read. lacking: SWP_ parameters that the rover does not have.

    enabled: SWP_ENABLE is 1. current: the file is identical to this program's. running: version that runs, 0
    for one that does not say (before 1.5).
    """

    file: AppletFile | None
    lacking: tuple[str, ...]
    enabled: bool
    current: bool
    running: float

    @property
    def runs(self) -> bool:
        """Whether this program's version of the applet runs."""
        return not self.lacking and _is_ours({"SWP_VER": self.running})

    @property
    def fits(self) -> bool:
        """Whether this program's applet runs, enabled; a file that cannot be read is not a fault."""
        return self.runs and self.enabled and (self.current or self.file is None)

    @property
    def sentence(self) -> str:
        """The state in one sentence."""
        mine = version_of(applet_source())
        if len(self.lacking) == len(PARAMETERS):
            why = f"{self.file.path} exists but does not run" if self.file else "its file is not on the rover"
            return f"the applet does not run: {why}"
        if self.lacking:
            return f"another version of the applet runs: it has no {', '.join(self.lacking)}"
        if not self.runs:
            return (
                f"applet {self.running:.7g} runs, not {mine}: the rover has not restarted since it was copied"
            )
        if not self.enabled:
            return "the applet is switched off: SWP_ENABLE is 0"
        if self.file is None:
            return "the applet runs; its version cannot be read (no MAVLink FTP, or under another name)"
        if not self.current:
            other = self.file.version or "none"
            how = f"version {other}, not {mine}" if other != mine else f"version {mine}, but changed"
            return f"{self.file.path} is not this program's applet ({how})"
        return f"applet {mine} runs ({self.file.path})"


@dataclass(frozen=True)
class Survey:
    """A rover against a list of wanted parameters and this program's applet."""

    vehicle: VehicleIdentity
    parameters: tuple[SurveyedParameter, ...]
    applet: AppletState

    @property
    def fits(self) -> bool:
        return self.applet.fits and all(p.fits for p in self.parameters)


def survey(link: Link, wanted: Sequence[WantedParameter]) -> Survey:
    """Compare the rover with the wanted parameters and the applet; changes nothing. LinkError for anything
    but an ArduPilot Rover."""
    vehicle = identify_vehicle(link)
    has = read_present(link, [*(p.name for p in wanted), *(p.name for p in PARAMETERS)])
    file = read_applet(link, applet_path().name, applet_source())
    lacking = tuple(p.name for p in PARAMETERS if p.name not in has)
    current = file is not None and file.text == applet_source()
    applet = AppletState(file, lacking, has.get("SWP_ENABLE") == 1, current, has.get("SWP_VER", 0.0))
    return Survey(vehicle, tuple(SurveyedParameter(p, has.get(p.name)) for p in wanted), applet)


# Writes a .param file to a rover: sets the parameters that differ, reads them back, reboots if needed.
#
# It can be interrupted anywhere and repeated: parameters already set no longer differ, and those that wait
# for a reboot are noted in a folder before the reboot (`note`).


# Parameters that take effect after a reboot only, in addition to those that a file marks with [reboot]
# (@RebootRequired in the sources of Rover-4.6.3).
NEED_REBOOT = frozenset(
    {
        *("SCR_ENABLE", "SCR_HEAP_SIZE", "SCHED_LOOP_RATE", "LOG_BACKEND_TYPE", "LOG_FILE_BUFSIZE"),
        *("AHRS_ORIENTATION", "EK3_ENABLE", "BATT_MONITOR", "INS_GYRO_RATE", "CAN_P1_DRIVER", "RC_PROTOCOLS"),
        *("GPS1_TYPE", "GPS_TYPE", "COMPASS_ENABLE", "FRAME_CLASS"),
    }
)


def needs_reboot(name: str, marked: bool = False) -> bool:
    """Whether a parameter is known to take effect after a reboot only. marked: by its file."""
    return marked or name in NEED_REBOOT or (name.startswith("SERIAL") and name.endswith("_PROTOCOL"))


def awaiting_reboot(link: Link, folder: Path) -> tuple[str, ...]:
    """Names of parameters that an earlier push or remedy noted in `folder` and that still need a reboot."""
    return waiting(folder, *_boot(link))


def push(
    link: Link, source: ParameterSource, differences: Sequence[Difference], may_reboot: Consent, folder: Path
) -> Iterator[Event]:
    """Set the parameters that differ, and reboot if that is needed and allowed. LinkError while armed.

    Yields ParameterSet for each, Rebooting, and a Notice for each parameter that the rover does not have,
    does not keep as set (read-only, integer, out of range) or that still needs a reboot.
    """
    refuse_armed(link)
    vehicle, boots = _boot(link)
    noted = waiting(folder, vehicle, boots)
    for difference in differences:
        if difference.found is None:
            yield Notice("warning", difference.sentence)
            continue
        restart = needs_reboot(difference.name, difference.needs_reboot)
        if restart:  # noted before it is set: an interruption in between must not hide the reboot
            note(folder, vehicle, boots, [difference.name])
        try:
            written = source.write(difference.name, difference.wanted)
        except ParameterKept as kept:
            if restart and difference.name not in noted:
                withdraw(folder, vehicle, boots, difference.name)
            yield Notice("warning", str(kept))
            continue
        yield dataclasses.replace(written, reboot=restart)
    because = waiting(folder, vehicle, boots)
    if not because:
        return
    if not may_reboot(because):
        yield Notice("warning", f"{', '.join(because)} will take effect after a reboot")
        return
    yield Rebooting(because)
    reboot(link)
    forget(folder)


def _boot(link: Link) -> tuple[VehicleIdentity, float]:
    return identify_vehicle(link), read_present(link, ["STAT_BOOTCNT"]).get("STAT_BOOTCNT", 0.0)
