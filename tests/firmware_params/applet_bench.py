"""A fake autopilot on a bench: the test sets what the applet senses and sees all that it does."""

from __future__ import annotations

import random
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from firmware_params.applet_parameters import applet_source
from sitl.autopilot.lua_host import LuaHost, Vector

LOW, MIDDLE, HIGH = 0, 1, 2
STEERING_CHANNEL, TRIM = 0, 1500
VEHICLE = {"SERVO1_TRIM": TRIM, "SERVO1_MIN": 1100, "SERVO1_MAX": 1900, "RCMAP_ROLL": 1, "RC1_TRIM": 1500}
VEHICLE |= {"RCMAP_THROTTLE": 3, "RC3_TRIM": 1500, "RC_OVERRIDE_TIME": 3.0}
KINDS: dict[str, dict[str, float]] = {
    "sweep": {"type": 0},
    "doublet": {"type": 1, "pulse": 2, "count": 5},
    "multisine": {"type": 2, "count": 2},
    "bias sweep": {"type": 3, "bias": 100},
}  # SWP_ values of each kind of run, within the limits as they come
LABELS = "Run,St,T,Cmd,Out,VN,VE"
SOONEST_S = 0.09  # one update, the longest gap of the real firmware included


@dataclass
class Bench:
    """Implements lua_host.Autopilot. Time starts at `now` us; gaps between updates are irregular."""

    now: int = 5_000_000
    parameters: dict[str, float] = field(default_factory=lambda: dict(VEHICLE))
    switch: int | None = LOW
    rc: dict[int, int] = field(default_factory=lambda: {1: 1500, 6: 1100})
    is_rc_valid: bool = True
    is_armed: bool = True
    arming_answers: list[bool] = field(default_factory=list)
    current_mode: int = 0
    changes_mode: bool = True  # False: the vehicle refuses
    roll: float = 0.0
    rates: Vector = (0.0, 0.0, 0.0)
    velocity: Vector | None = (0.0, 0.0, 0.0)
    heard_ms: int | None = None
    pilot_pwm: int = 1500
    forced_output: int | None = None
    steering_channel: int | None = STEERING_CHANNEL
    override: tuple[int, int] = (0, 0)
    overrides: list[tuple[int, int, int, bool]] = field(default_factory=list)
    given_back: list[int] = field(default_factory=list)  # RC channels whose override the applet ended
    texts: list[str] = field(default_factory=list)
    floats: list[tuple[int, str, float]] = field(default_factory=list)
    log: list[dict[str, float]] = field(default_factory=list)

    def micros(self) -> int:
        return self.now

    def add_parameter(self, name: str, default: float) -> bool:
        self.parameters.setdefault(name, float(np.float32(default)))
        return True

    def get_parameter(self, name: str) -> float | None:
        return self.parameters.get(name)

    def set_parameter(self, name: str, value: float, save: bool) -> bool:
        self.parameters[name] = float(np.float32(value))
        return True

    def rc_pwm(self, channel: int) -> int | None:
        return self.rc.get(channel, 0)

    def override_rc(self, channel: int, pwm: int) -> None:
        assert pwm == 0, "the applet overrides no RC channel"
        self.given_back.append(channel)

    def rc_with_option(self, option: int) -> int | None:
        return 6 if option == 300 else None

    def aux_position(self, function: int) -> int | None:
        return self.switch if function == 300 else None

    def rc_valid(self) -> bool:
        return self.is_rc_valid

    def armed(self) -> bool:
        return self.arming_answers.pop(0) if self.arming_answers else self.is_armed

    def disarm(self) -> bool:
        self.is_armed = False
        return True

    def mode(self) -> int:
        return self.current_mode

    def set_mode(self, mode: int) -> bool:
        self.current_mode = mode if self.changes_mode else self.current_mode
        return self.changes_mode

    def servo_channel(self, function: int) -> int | None:
        return self.steering_channel if function == 26 else None

    def override_servo(self, channel: int, pwm: int, timeout_ms: int) -> None:
        assert channel == STEERING_CHANNEL
        self.override = (pwm, self.now + timeout_ms * 1000)
        self.overrides.append((self.now, pwm, timeout_ms, self.is_armed))

    def servo_pwm(self, channel: int) -> int:
        if self.forced_output is not None:
            return self.forced_output
        pwm, until = self.override
        return pwm if self.now < until else self.pilot_pwm

    def gyro(self) -> Vector:
        return self.rates

    def accel(self) -> Vector:
        return (0.0, 0.0, -9.81)

    def attitude(self) -> Vector:
        return (self.roll, 0.0, 0.0)

    def velocity_ned(self) -> Vector | None:
        return self.velocity

    def gcs_last_seen_ms(self) -> int:
        return self.now // 1000 if self.heard_ms is None else self.heard_ms

    def log_write(
        self, name: str, labels: str, format: str, values: tuple[Any, ...], units: str, multipliers: str
    ) -> None:
        assert (name, labels, format, units) == ("SWEP", LABELS, "HBfffff", "--sYYnn")
        self.log.append({"t": self.now * 1e-6, **dict(zip(labels.split(","), values, strict=True))})

    def statustext(self, severity: int, text: str) -> None:
        assert len(text) <= 50 or text.startswith("Lua: "), f"more than one STATUSTEXT: {text}"
        self.texts.append(text)

    def named_float(self, name: str, value: float) -> None:
        assert len(name) <= 10
        self.floats.append((self.now, name, value))

    @property
    def state(self) -> int:
        return int(next(value for _, name, value in reversed(self.floats) if name == "SWP_ST"))

    @property
    def said(self) -> str:
        return "\n".join(self.texts)


class Drive:
    """The applet on a bench, with the update gaps of the real firmware: 10 to 17 ms, now and then 72 ms."""

    def __init__(self, bench: Bench, source: str | None = None, removed: tuple[str, ...] = ()) -> None:
        self.bench = bench
        self.host = LuaHost(bench, source or applet_source(), "rover_sweep.lua", removed)
        self._random = random.Random(6)
        self.host.poll()

    def run(self, seconds: float) -> None:
        """Let vehicle time go by."""
        end = self.bench.now + round(seconds * 1e6)
        while self.bench.now < end:
            gap = 72_000 if self._random.random() < 0.01 else self._random.randint(10_000, 17_000)
            self.bench.now += gap
            self.host.poll()

    def pause(self, seconds: float) -> None:
        """Let vehicle time go by in which the applet gets no turn, then give it one."""
        self.bench.now += round(seconds * 1e6)
        self.host.poll()

    def run_until(self, state: int, limit: float = 120.0) -> None:
        """Let time go by until the applet is in `state`."""
        start = self.bench.now
        while self.bench.state != state:
            assert self.bench.now - start < limit * 1e6, (
                f"state {self.bench.state}, not {state}: {self.bench.said}"
            )
            self.run(0.001)


def moving(speed: float = 2.0, **settings: float) -> Bench:
    """A bench with a rover that drives straight in the middle of its band, and SWP_ values preset."""
    bench = Bench(velocity=(0.6 * speed, 0.8 * speed, 0.0))
    bench.parameters |= {f"SWP_{name.upper()}": value for name, value in settings.items()}
    return bench


def throw_switch(drive: Drive) -> None:
    """Low for half a second, then high."""
    drive.bench.switch = LOW
    drive.run(0.5)
    drive.bench.switch = HIGH
    drive.run(0.02)


def thrown(
    bench: Bench, source: str | None = None, removed: tuple[str, ...] = (), seconds: float = 0.0
) -> Drive:
    """The applet on a bench, its switch thrown, some seconds later."""
    drive = Drive(bench, source, removed)
    throw_switch(drive)
    drive.run(seconds)
    return drive


def mutant(*changes: tuple[str, str]) -> str:
    """The applet's source with each `old` replaced by its `new`; each must be there once."""
    source = applet_source()
    for old, new in changes:
        assert source.count(old) == 1, f"{old!r} is there {source.count(old)} times"
        source = source.replace(old, new)
    return source


def without(line: str) -> str:
    """The applet's source without the one line that contains `line`."""
    lines = applet_source().splitlines()
    hits = [i for i, text in enumerate(lines) if line in text]
    assert len(hits) == 1, f"{len(hits)} lines contain {line!r}"
    return "\n".join(lines[: hits[0]] + lines[hits[0] + 1 :])


def happen(bench: Bench, changes: Mapping[str, Any]) -> None:
    """Changes fields of the bench, and parameters (in capitals)."""
    for name, value in changes.items():
        if name.isupper():
            bench.parameters[name] = value
        else:
            setattr(bench, name, value)
