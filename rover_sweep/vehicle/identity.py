"""The vehicle on the link: firmware, its version, and whether the applet runs on it."""

from __future__ import annotations

from dataclasses import dataclass

from firmware_params.applet_parameters import PARAMETERS
from rover_sweep.errors import LinkError
from rover_sweep.files.documents import printable
from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.link.mavlink import constant, vehicle_type_name
from rover_sweep.vehicle.parameters import ParameterMissing, read_parameter, read_present

OLDEST = (4, 5)  # the applet is written for ArduRover 4.5 and 4.6
NEWEST = (4, 6)
_ARDUPILOT = 3  # MAV_AUTOPILOT_ARDUPILOTMEGA


@dataclass(frozen=True)
class VehicleIdentity:
    """An ArduPilot Rover. version: (major, minor, patch); git_hash: first 8 characters; uid: of the board;
    system: MAVLink system id."""

    firmware: str
    version: tuple[int, int, int]
    git_hash: str
    uid: int
    system: int

    @property
    def words(self) -> str:
        """Firmware, version and system id, as a phrase."""
        return f"{self.firmware} (system {self.system})"


def identify_vehicle(link: Link) -> VehicleIdentity:
    """Request AUTOPILOT_VERSION. LinkError for anything but an ArduPilot Rover from 4.5 on."""
    heartbeat = link.heartbeat
    assert heartbeat is not None  # Link.open waits for it
    if heartbeat.autopilot != _ARDUPILOT:
        raise LinkError(f"the autopilot on {link.url} is not ArduPilot (MAV_AUTOPILOT {heartbeat.autopilot})")
    if heartbeat.type != constant("MAV_TYPE_GROUND_ROVER"):
        raise LinkError(
            f"the vehicle on {link.url} is a {vehicle_type_name(heartbeat.type)}, not a ground rover; "
            "sweeps need a wheeled vehicle with steering"
        )
    answer = link.request_message("AUTOPILOT_VERSION")
    if answer is None:
        silent = f"the rover on {link.url} does not report its version (AUTOPILOT_VERSION)"
        raise link.no_answer(silent, "is the link too slow?")
    version = link.version = _version(answer.flight_sw_version)
    if version[:2] < OLDEST:
        raise LinkError(
            f"ArduRover {'.'.join(map(str, version))} is too old for the applet, "
            f"which needs {OLDEST[0]}.{OLDEST[1]} or newer"
        )
    return VehicleIdentity(
        firmware=f"ArduRover {'.'.join(map(str, version))}",
        version=version,
        git_hash=printable(bytes(answer.flight_custom_version).rstrip(b"\0").decode("ascii", "replace")),
        uid=int(answer.uid),
        system=link.target[0],
    )


def untested(vehicle: VehicleIdentity) -> str:
    """A warning if the firmware is newer than all versions that the applet was tested on, else ''."""
    if vehicle.version[:2] <= NEWEST:
        return ""
    return (
        f"{vehicle.firmware} is newer than {NEWEST[0]}.{NEWEST[1]}, the last version the applet was tested on"
    )


class AppletUnready(LinkError):
    """The applet cannot drive a run. found: why, without the command that repairs it."""

    def __init__(self, found: str, repair: str = "`rover-sweep firmware install` installs it") -> None:
        super().__init__(f"{found}; {repair}")
        self.found = found


def check_applet(link: Link) -> dict[str, float]:
    """The applet's parameters, which prove that it runs.

    AppletUnready if it does not run, is off or has another version; LinkError on a board without scripting.
    """
    present = read_present(link, [p.name for p in PARAMETERS])
    if "SWP_ENABLE" not in present:
        raise _no_applet(link)
    lacking = [p.name for p in PARAMETERS if p.name not in present]
    if lacking:
        raise AppletUnready(f"the applet on the rover has another version (no {', '.join(lacking)})")
    if present["SWP_ENABLE"] == 0:
        raise AppletUnready("the applet is switched off (SWP_ENABLE 0)", "set SWP_ENABLE to 1")
    return present


def _no_applet(link: Link) -> LinkError:
    try:
        scripting = read_parameter(link, "SCR_ENABLE")
    except ParameterMissing:
        return LinkError("this firmware has no Lua scripting (no SCR_ENABLE); use a board with scripting")
    if scripting == 0:
        return AppletUnready("the sweep applet does not run (SCR_ENABLE is 0)")
    return AppletUnready(
        "the sweep applet does not run (no parameter SWP_ENABLE)",
        "install it with `rover-sweep firmware install`, and look for script errors in the rover's messages",
    )


def _version(packed: int) -> tuple[int, int, int]:
    return packed >> 24 & 0xFF, packed >> 16 & 0xFF, packed >> 8 & 0xFF


# Names of ArduRover's modes (Rover/mode.h, Mode::Number, 4.5 and 4.6).


MODES = {
    0: "MANUAL",
    1: "ACRO",
    3: "STEERING",
    4: "HOLD",
    5: "LOITER",
    6: "FOLLOW",
    7: "SIMPLE",
    8: "DOCK",
    9: "CIRCLE",
    10: "AUTO",
    11: "RTL",
    12: "SMART_RTL",
    15: "GUIDED",
    16: "INITIALISING",
}


def mode_name(mode: int) -> str:
    """Rover's custom_mode as a word (Rover/mode.h, 4.6.3)."""
    return MODES.get(mode, f"mode {mode}")


# Whether the EKF estimates velocity and position (EKF_STATUS_REPORT).


def has_position(flags: int) -> bool:
    """Whether horizontal velocity and absolute position are estimated. flags: EKF_STATUS_FLAGS."""
    wanted = constant("EKF_VELOCITY_HORIZ") | constant("EKF_POS_HORIZ_ABS")
    return flags & wanted == wanted and not flags & constant("EKF_CONST_POS_MODE")


def estimator_ready(link: Link) -> bool:
    """Ask the vehicle; False also if it does not answer."""
    report = link.request_message("EKF_STATUS_REPORT")
    return report is not None and has_position(int(report.flags))
