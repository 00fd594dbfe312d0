"""Runs an ArduPilot applet under a desktop Lua 5.3, on any object that behaves as an autopilot.

The applet sees the names, arguments and return values that ArduPilot's bindings give it (libraries/
AP_Scripting/generator/description/bindings.desc of Rover-4.6.3); `lua_api.lua` makes them. What a
desktop Lua cannot give: ArduPilot's numbers are 32-bit integers and single floats, here they are 64-bit
and double, and its userdata are tables here. uint32_t wraps, compares and divides as on the vehicle.
"""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import Any, Protocol

CRITICAL = 2  # MAV_SEVERITY_CRITICAL, with which ArduPilot reports a script's error
Vector = tuple[float, float, float]


class Autopilot(Protocol):
    """What an applet can ask of the vehicle and do to it. Axes are FRD and NED, units SI and us."""

    def micros(self) -> int:
        """Vehicle time since boot, us; need not wrap (the host wraps it at 32 bits)."""

    def add_parameter(self, name: str, default: float) -> bool:
        """Add a parameter of a script by its full name; one that exists keeps its value. False: refused."""

    def get_parameter(self, name: str) -> float | None:
        """A parameter's value, None where it does not exist."""

    def set_parameter(self, name: str, value: float, save: bool) -> bool:
        """Set an existing parameter; `save` keeps it over a reboot. False where it does not exist."""

    def rc_pwm(self, channel: int) -> int | None:
        """RC input of channel 1..16 [us], override included; None where there is no such channel."""

    def aux_position(self, function: int) -> int | None:
        """Cached position of an auxiliary function: 0 low, 1 middle, 2 high; None if it was never set."""

    def rc_valid(self) -> bool:
        """False in the RC (throttle) failsafe; Rover's rc:has_valid_input."""

    def armed(self) -> bool: ...

    def mode(self) -> int:
        """Custom mode number, 0 is MANUAL."""

    def servo_channel(self, function: int) -> int | None:
        """First servo output with SERVOn_FUNCTION == function, 0-based; None where there is none."""

    def override_servo(self, channel: int, pwm: int, timeout_ms: int) -> None:
        """Put `pwm` on output `channel` (0-based) for ceil(timeout / loop period) main loops.

        It works disarmed too. A timeout of 0 ends an override: the next main loop computes the output
        from the pilot again (SRV_Channels::set_output_pwm_chan_timeout and calc_pwm, 4.5.7 and 4.6.3).
        """

    def servo_pwm(self, channel: int) -> int:
        """PWM of output `channel` (0-based) [us], an override included at once."""

    def gyro(self) -> Vector:
        """Filtered body rates [rad/s], FRD."""

    def accel(self) -> Vector:
        """Filtered specific force [m/s^2], FRD."""

    def attitude(self) -> Vector:
        """Roll, pitch, yaw [rad]."""

    def velocity_ned(self) -> Vector | None:
        """EKF velocity [m/s], None while there is no estimate."""

    def gcs_last_seen_ms(self) -> int:
        """Vehicle time at which the ground station SYSID_MYGCS was last heard, ms; 0 for never."""

    def log_write(
        self, name: str, labels: str, format: str, values: tuple[Any, ...], units: str, multipliers: str
    ) -> None:
        """Log a message of its own. TimeUS ('Q', unit 's', multiplier 'F') is still to be put in front.

        units and multipliers are "" where the script gave none.
        """

    def statustext(self, severity: int, text: str) -> None: ...

    def named_float(self, name: str, value: float) -> None: ...


class LuaHost:
    """One script on one autopilot. Call `poll` as often as the vehicle's time moves on.

    source: the applet's text. removed: calls to leave out, to be like another version or build, e.g.
    {"SRV_Channels:get_output_pwm_chan"} for 4.5.7; a bare name removes a whole object.
    """

    error: str | None
    """The message of the error that stopped the script."""
    running: bool
    """False after an error, or when the script asked for no further call."""
    next_run_ms: int
    """Vehicle time [ms] at which the next `poll` runs the script."""

    def __init__(
        self, autopilot: Autopilot, source: str, name: str = "applet.lua", removed: Collection[str] = ()
    ) -> None:
        raise NotImplementedError(Path(name))

    def poll(self) -> bool:
        """Run the script if its time has come; True if it ran."""
        raise NotImplementedError
