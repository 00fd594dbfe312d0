"""A source that plays what a test tells it, and notes what it was asked."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

from rover_sweep.live.source import (
    Checked,
    CoherenceBand,
    Connect,
    DriveRequest,
    Ended,
    Judged,
    Request,
    Snapshot,
    Update,
    Verdict,
)
from rover_sweep.manoeuvre.sweep import FIRST_SWEEPS, Doublet
from rover_sweep.session.session import SessionRun
from rover_sweep.vehicle import events as e
from rover_sweep.vehicle.identity import VehicleIdentity
from rover_sweep.vehicle.preflight.read_rover import Check, Remedy
from rover_sweep.vehicle.run.controls import RunSettings

URL = "tcp:127.0.0.1:5760"
ROVER = VehicleIdentity("ArduRover 4.6.3", (4, 6, 3), "3fc7011a", 1, 1)
SWEEP = FIRST_SWEEPS[0]
TLOG = Path("sweep1.tlog")


@dataclass
class ScriptedSource:
    """asked, aborted, closed: what the screen did."""

    asked: list[Request] = field(default_factory=list)
    aborted: int = 0
    closed: bool = False
    tell: Callable[[Update], None] = lambda told: None

    def start(self, tell: Callable[[Update], None]) -> None:
        self.tell = tell

    def ask(self, request: Request) -> None:
        self.asked.append(request)

    def abort(self) -> None:
        self.aborted += 1

    def close(self) -> str:
        self.closed = True
        return ""


CHECKS = (
    Check("firmware", "good", "ArduRover 4.6.3 (3fc7011a)"),
    Check(
        "applet",
        "bad",
        "it does not run",
        "The applet is not on the rover.",
        Remedy("bring the applet onto the rover and restart its scripts"),
    ),
    Check(
        "parameters",
        "bad",
        "3 of 31 differ: SCR_ENABLE 0, LOG_BITMASK 65535, LOG_DISARMED 0",
        "SCR_ENABLE, LOG_BITMASK and LOG_DISARMED are not what an identification wants.",
        Remedy("set 3 parameters", reboot=True),
    ),
    Check("loop_rate", "good", "400 Hz"),
    Check("ekf", "good", "velocity and position from GPS"),
    Check("gps", "good", "3D fix, 14 satellites"),
    Check(
        "battery",
        "doubtful",
        "11.1 V, 34 %",
        "34 % are left, and the plan takes 3 minutes.",
        Remedy("put in a full battery", by_hand=True),
    ),
    Check("rc", "good", "heard"),
    Check(
        "switch",
        "bad",
        "HIGH, 1950 us",
        "Switch 6 is high: a run would start at once.",
        Remedy("throw switch 6 low", by_hand=True),
    ),
    Check("disk", "good", "52 GB free"),
    Check("mode", "unknown", "not heard of"),
)

VERDICT = Verdict(
    "sweep1",
    "repeat",
    "repeat with 220 us: the roll rate's coherence is 0.41 at 14 rad/s, and 0.6 is needed.",
    (
        CoherenceBand("r", 0.3, 2.0, 0.99, "very good"),
        CoherenceBand("r", 2.0, 25.0, 0.93, "good"),
        CoherenceBand("ay", 0.3, 2.0, 0.95, "good"),
        CoherenceBand("ay", 2.0, 25.0, 0.88, "good"),
        CoherenceBand("p", 0.3, 2.0, 0.55, "weak"),
        CoherenceBand("p", 2.0, 25.0, 0.41, "too weak to use"),
    ),
    219.7,  # as it is computed; planned in whole us
    ((0.3, 2.0, 180.0), (2.0, 25.0, 220.0)),
    TLOG,
    ("the speed fell from 2.4 to 2.1 m/s",),
)


def snapshot(t: float, **changed: object) -> Snapshot:
    """A rover that steers to and fro, at t s."""
    steering = 140 * math.sin(2.2 * t)
    now = Snapshot(
        t=t,
        armed=True,
        mode=0,
        pwm=1500 + steering,
        r=-0.006 * steering,
        p=0.05 * math.cos(2.2 * t),
        ay=-0.014 * steering,
        phi=0.0006 * steering,
        speed=2.37,
        state=6,
        state_name="manoeuvre",
        frequency=2.2,
        progress=0.45,
        switch=1950.0,
        volts=11.8,
        remaining=0.72,
        satellites=14,
        fix=3,
        ekf=True,
        received=310.0,
        recorded=1_234_000,
    )
    return replace(now, **changed)  # type: ignore[arg-type]


def connected() -> list[Update]:
    """Connected, looked at."""
    still = snapshot(
        1.0,
        armed=False,
        state=0,
        state_name="idle",
        pwm=1500.0,
        r=0.0,
        ay=0.0,
        phi=0.0,
        speed=0.0,
        switch=1000.0,
        progress=math.nan,
        frequency=math.nan,
    )
    return [e.Connected(URL, ROVER), Ended(Connect(URL)), still, Checked(CHECKS)]


def drive(name: str = "sweep1", settings: RunSettings | None = None) -> DriveRequest:
    """A request."""
    return DriveRequest(SessionRun(name, SWEEP, 2.0), settings or RunSettings())


def under_way() -> list[Update]:
    """A sweep up to the middle of its law; the request is the screen's."""
    return [
        e.RunStarted("sweep1", SWEEP, TLOG),
        e.Armed(3.0),
        e.SwitchWanted("high", 6),
        e.Said(4.0, 6, "SWP: run 1 start sweep"),
        e.StateChanged(5.0, 3, "straight before"),
        e.StateChanged(9.0, 6, "manoeuvre"),
        *(snapshot(9.0 + 0.1 * n) for n in range(60)),
    ]


def finished() -> list[Update]:
    """Its end and verdict."""
    end = snapshot(75.0, state=0, state_name="idle", progress=math.nan, frequency=math.nan, switch=1000.0)
    return [
        e.SwitchWanted("low", 6),
        e.RunFinished("sweep1", True, "the manoeuvre ran to its end", TLOG, (4.0, 70.0), 1, ()),
        end,
        Ended(drive()),
        Judged(VERDICT),
    ]


DOUBLET = Doublet()
