"""The Lua scripts of the embedded rover, and what they may ask of it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

from sitl.autopilot.lua_host import LuaHost
from sitl.autopilot.radio import Radio
from sitl.autopilot.servo_outputs import ServoOutputs
from sitl.autopilot.vehicle_log import VehicleLog
from sitl.autopilot.vehicle_parameters import ParameterStore
from sitl.plant.sensors import Sensors

Vector = tuple[float, float, float]
SCRIPTING = 32  # ModeReason (AP_Vehicle/ModeReason.h, 4.6.3)


class ScriptedRover(Protocol):
    """Interface of a rover to its scripts."""

    parameters: ParameterStore
    radio: Radio
    servos: ServoOutputs
    sensors: Sensors
    log: VehicleLog
    aux: dict[int, int]
    failsafe_bits: int
    armed: bool
    mode: int
    now_us: int
    gcs_seen_ms: int

    def disarm(self) -> None:
        """Disarms."""

    def set_mode(self, mode: int, reason: int) -> bool:
        """Changes the mode."""

    @property
    def now_ms(self) -> int:
        """Vehicle time [ms]."""

    @property
    def origin_set(self) -> bool:
        """Whether the EKF has an origin, and with it a velocity."""

    def text(self, severity: int, text: str) -> None:
        """Sends a STATUSTEXT."""

    @property
    def on_named_float(self) -> Callable[[str, float], None]:
        """Sends a NAMED_VALUE_FLOAT."""


class ScriptAutopilot:
    """The `Autopilot` that scripts see: one rover."""

    def __init__(self, rover: ScriptedRover) -> None:
        self._rover = rover

    def micros(self) -> int:
        return self._rover.now_us

    def add_parameter(self, name: str, default: float) -> bool:
        return self._rover.parameters.add(name, default)

    def get_parameter(self, name: str) -> float | None:
        parameter = self._rover.parameters.find(name)
        return None if parameter is None else parameter.value

    def set_parameter(self, name: str, value: float, save: bool) -> bool:
        return self._rover.parameters.set(name, value, save) is not None

    def rc_pwm(self, channel: int) -> int | None:
        return self._rover.radio.pwm[channel - 1] if 1 <= channel <= 16 else None

    def aux_position(self, function: int) -> int | None:
        return self._rover.aux.get(function)

    def override_rc(self, channel: int, pwm: int) -> None:
        self._rover.radio.set_override(channel, pwm, self._rover.now_ms)

    def rc_with_option(self, option: int) -> int | None:
        parameters = self._rover.parameters
        return next((n for n in range(1, 17) if parameters[f"RC{n}_OPTION"] == option), None)

    def rc_valid(self) -> bool:
        return not self._rover.failsafe_bits & 1 and self._rover.radio.seen

    def armed(self) -> bool:
        return self._rover.armed

    def disarm(self) -> bool:
        self._rover.disarm()
        return True

    def mode(self) -> int:
        return self._rover.mode

    def set_mode(self, mode: int) -> bool:
        return self._rover.set_mode(mode, SCRIPTING)

    def servo_channel(self, function: int) -> int | None:
        return self._rover.servos.channel_of(function)

    def override_servo(self, channel: int, pwm: int, timeout_ms: int) -> None:
        self._rover.servos.override(channel, pwm, timeout_ms)

    def servo_pwm(self, channel: int) -> int:
        return self._rover.servos.pwm[channel]

    def gyro(self) -> Vector:
        return self._rover.sensors.gyro

    def accel(self) -> Vector:
        return self._rover.sensors.accel

    def attitude(self) -> Vector:
        return self._rover.sensors.attitude

    def velocity_ned(self) -> Vector | None:
        return self._rover.sensors.velocity if self._rover.origin_set else None

    def gcs_last_seen_ms(self) -> int:
        return self._rover.gcs_seen_ms

    def log_write(
        self, name: str, labels: str, format: str, values: tuple[Any, ...], units: str, multipliers: str
    ) -> None:
        self._rover.log.script_write(name, labels, format, values, units, multipliers)

    def statustext(self, severity: int, text: str) -> None:
        self._rover.text(severity, text)

    def named_float(self, name: str, value: float) -> None:
        self._rover.on_named_float(name, value)


class Scripts:
    """Every *.lua of a directory, loaded at boot where SCR_ENABLE = 1, each in a Lua of its own."""

    def __init__(self, rover: ScriptedRover, directory: Path) -> None:
        self._autopilot = ScriptAutopilot(rover)
        self._rover = rover
        self._directory = directory
        self._enabled = rover.parameters["SCR_ENABLE"] != 0
        self._hosts: list[LuaHost] | None = None
        directory.mkdir(parents=True, exist_ok=True)

    def poll(self) -> None:
        """Runs the scripts whose time has come."""
        if not self._enabled:
            return
        if self._hosts is None:
            self._load()
        for host in self._hosts or ():
            host.poll()

    def _load(self) -> None:
        sources = sorted(self._directory.glob("*.lua"))
        self._hosts = []
        for path in sources:
            self._hosts.append(LuaHost(self._autopilot, path.read_text(encoding="utf-8"), path.name))

    def restart(self) -> None:
        """MAV_CMD_SCRIPTING 3: drops every script and loads the directory again."""
        if self._enabled:
            self._rover.text(6, "Scripting: restarted")
        self._hosts = None

    def stop(self) -> None:
        """MAV_CMD_SCRIPTING 2: no script runs until a restart."""
        if self._enabled:
            self._rover.text(2, "Scripting: stopped")
        self._hosts = []

    @property
    def error(self) -> str | None:
        """The first error that stopped a script."""
        return next((host.error for host in self._hosts or () if host.error), None)
