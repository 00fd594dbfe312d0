"""A turn-rate profile driven in ACRO mode on the real firmware (SITL), with several sets of parameters."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

from acro_drive import FULL, Profile, Segment

from firmware_params.param_files import shipped
from rover_sweep.gains.steering_chain import DEFAULTS, Autopilot, autopilot
from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.link.mavlink import message_id
from rover_sweep.vehicle.parameters import read_all, write_parameter
from rover_sweep.vehicle.run.controls import pump
from sitl.launcher import start_ardurover
from tests.ardurover.arming import arm_in_mode

ACRO = 1  # custom_mode of Rover
SPEED = 2.5  # m/s
ACRO_RATE = 90.0  # deg/s at full stick
CRUISE_THROTTLE = 52.0  # percent that give SPEED on the nominal plant
SETTINGS = {
    "ACRO_TURN_RATE": ACRO_RATE,
    "CRUISE_SPEED": SPEED,
    "CRUISE_THROTTLE": CRUISE_THROTTLE,
    "SCR_ENABLE": 0,
    "GCS_PID_MASK": 3,
}
STRAIGHT = 6.0  # s, to reach the speed before a profile


class Stick:
    """The pilot's sticks over RC override: steering by the profile, throttle as a share of full."""

    def __init__(self, link: Link, parameters: Mapping[str, float], profile: Profile) -> None:
        self.link, self.parameters, self.profile = link, parameters, profile
        self.throttle, self.start = 0.0, math.inf
        link.every(0.02, self.send)

    def send(self) -> None:
        """Both sticks as they are now."""
        rate = self.profile.rate(self.link.clock.now - self.start)
        channels = {1: self._pwm(1, math.degrees(rate) / ACRO_RATE), 3: self._pwm(3, self.throttle)}
        fields = {f"chan{n}_raw": channels.get(n, 0xFFFF) for n in range(1, 17)}
        self.link.to_vehicle("RC_CHANNELS_OVERRIDE", **fields, chan17_raw=0, chan18_raw=0)

    def _pwm(self, channel: int, share: float) -> int:
        """As RC_Channel::pwm_to_angle_dz takes it: the dead zone lies between trim and the first movement."""
        trim, end, dead = (self.parameters[f"RC{channel}_{k}"] for k in ("TRIM", "MAX", "DZ"))
        return (
            round(trim + math.copysign(dead, share) + share * (end - trim - dead)) if share else round(trim)
        )


def drive(
    binary: Path,
    folder: Path,
    sets: Mapping[str, Mapping[str, float]],
    profile: Profile = FULL,
    speedup: float = 1.0,
    speed: float = SPEED,
    variant: str | Path = "nominal",
) -> tuple[Path, list[Segment], Autopilot]:
    """(log, segments, the loop at first) of the profile with each set of parameters in turn.

    sets: {name: parameters}, each over the ones before; none for the firmware's defaults. speed [m/s]: a
    share of what the stick asks for, which `Rover/mode_acro.cpp` reckons from CRUISE_SPEED. PID_TUNING of
    both controllers is in `folder`/drive.tlog.
    """
    settings = folder / "settings.param"
    settings.write_text("".join(f"{n} {v:g}\n" for n, v in SETTINGS.items()), encoding="ascii")
    files = [shipped("identification"), settings]
    with (
        start_ardurover(
            binary, folder / "vehicle", variant=variant, defaults=files, speedup=speedup
        ) as rover,
        Link.open(rover.connection, folder / "drive.tlog") as link,
    ):
        pump(link, 10.0, 60.0)
        have = read_all(link)
        loop = autopilot(have)
        flown = loop.gains.parameters
        assert all(math.isclose(v, DEFAULTS[n], rel_tol=1e-6) for n, v in flown.items()), flown
        for name, interval in (("ATTITUDE", 0.02), ("PID_TUNING", 0.05)):
            link.require(
                f"send {name}", "MAV_CMD_SET_MESSAGE_INTERVAL", float(message_id(name)), interval * 1e6
            )
        stick = Stick(link, have, profile)
        arm_in_mode(link, ACRO, "ACRO")
        stick.throttle = CRUISE_THROTTLE / 100 * speed / SPEED
        told = []
        for name, parameters in sets.items():
            for key, value in parameters.items():
                write_parameter(link, key, value)
            flown = {**flown, **parameters}
            told.append(_driven(link, stick, name, flown))
        stick.throttle = 0.0
        pump(link, 3.0, 20.0)
        link.command("MAV_CMD_COMPONENT_ARM_DISARM", 0.0)
        pump(link, 1.0)
    return max((folder / "vehicle" / "logs").glob("*.BIN")), told, loop


def _driven(link: Link, stick: Stick, name: str, parameters: Mapping[str, float]) -> Segment:
    """Straight, then the profile."""
    pump(link, STRAIGHT, 60.0)
    stick.start = link.clock.now
    pump(link, stick.profile.length + 0.5, 300.0)
    begun, stick.start = stick.start, math.inf
    return Segment(name, begun, parameters)
