"""Runs an ArduPilot applet under a desktop Lua 5.3, on any object that behaves as an autopilot.

The applet sees the names, arguments and return values that ArduPilot's bindings give it (libraries/
AP_Scripting/generator/description/bindings.desc of Rover-4.6.3); `lua_api.lua` makes them. A desktop Lua
differs in its types: ArduPilot's numbers are 32-bit integers and single floats, here they are 64-bit
and double, and its userdata are tables here. uint32_t wraps, compares and divides as on the vehicle.
"""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import Any, Protocol

from lupa.lua53 import LuaRuntime

CRITICAL = 2  # MAV_SEVERITY_CRITICAL, with which ArduPilot reports a script's error
INSTRUCTION_LIMIT = 100_000  # ten times SCR_VM_I_COUNT's default: here the bindings are Lua and count too
_API = Path(__file__).with_name("lua_api.lua")
Vector = tuple[float, float, float]


class Autopilot(Protocol):
    """Functions of the vehicle that an applet can call. Axes are FRD and NED, units SI and us."""

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

    def override_rc(self, channel: int, pwm: int) -> None:
        """Override RC channel 1..16 as a ground station does [us]; 0 gives it back to the radio at once."""

    def rc_with_option(self, option: int) -> int | None:
        """First RC channel (1..16) with RCn_OPTION == option; None without one."""

    def rc_valid(self) -> bool:
        """False in the RC (throttle) failsafe; Rover's rc:has_valid_input."""

    def armed(self) -> bool: ...

    def disarm(self) -> bool:
        """Disarm, without the checks of a transmitter's disarming; False where it is refused."""

    def mode(self) -> int:
        """Custom mode number, 0 is MANUAL."""

    def set_mode(self, mode: int) -> bool:
        """Change the mode (ModeReason::SCRIPTING); False where the vehicle refuses."""

    def servo_channel(self, function: int) -> int | None:
        """First servo output with SERVOn_FUNCTION == function, 0-based; None without one."""

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

    Public state: `running` is False after an error or when the script asked for no further call;
    `error` is the message of the error that stopped it; `next_run_ms` is the vehicle time [ms] from
    which the next `poll` runs the script.
    """

    def __init__(
        self, autopilot: Autopilot, source: str, name: str = "applet.lua", removed: Collection[str] = ()
    ) -> None:
        self.error: str | None = None
        self.running = True
        self.next_run_ms = 0
        self._autopilot = autopilot
        self._name = name
        self._lua = LuaRuntime(
            unpack_returned_tuples=True, register_eval=False, register_builtins=False, encoding="utf-8"
        )
        environment, self._run = self._lua.execute(
            _API.read_text(encoding="utf-8"), self._functions(), INSTRUCTION_LIMIT
        )
        for call in removed:
            _remove(environment, call)
        loaded = self._lua.globals().load(source, "@" + name, "t", environment)
        self._function = loaded[0] if isinstance(loaded, tuple) else loaded
        if self._function is None:
            self._stop(f"Error: {loaded[1]}")

    def _functions(self) -> Any:
        ap = self._autopilot
        functions = {call: getattr(ap, call) for call in vars(Autopilot) if not call.startswith("_")}

        def log_write(name: str, labels: str, fmt: str, units: str, multipliers: str, *values: Any) -> None:
            ap.log_write(name, labels, fmt, values, units, multipliers)

        return self._lua.table_from({**functions, "log_write": log_write})

    def poll(self) -> bool:
        """Run the script if its time has come; True if it ran.

        An error of the script stops it, as lua_scripts::run_next_script does (pilot steering comes back
        when the override's timeout is over); an exception of the autopilot object is raised.
        """
        now_ms = self._autopilot.micros() // 1000
        if not self.running or now_ms < self.next_run_ms:
            return False
        results = self._run(self._function)
        succeeded, returned = (results[0], results[1:]) if isinstance(results, tuple) else (results, ())
        if not succeeded:
            if isinstance(returned[0], BaseException):
                raise returned[0]
            self._stop(str(returned[0]))
        else:
            self._reschedule(now_ms, returned)
        return True

    def _reschedule(self, now_ms: int, returned: tuple[Any, ...]) -> None:
        if not returned:
            self.running = False
        elif len(returned) != 2:
            self._stop(f"{self._name} returned bad result count ({len(returned)})")
        elif not isinstance(returned[1], int | float):
            self._stop(f"{self._name} did not return a delay")
        elif not callable(returned[0]):
            self._stop(f"{self._name} did not return a function")
        else:
            self._function, self.next_run_ms = returned[0], now_ms + int(returned[1])

    def _stop(self, message: str) -> None:
        self.running, self.error = False, message
        self._autopilot.statustext(CRITICAL, f"Lua: {message}")


def _remove(environment: Any, call: str) -> None:
    owner, _, method = call.partition(":")
    if owner not in environment or (method and method not in environment[owner]):
        raise ValueError(f"the Lua API has no {call}")
    if method:
        environment[owner][method] = None
    else:
        environment[owner] = None
