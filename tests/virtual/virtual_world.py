"""Rover, bad link and laptop on one virtual clock: nothing sleeps, no sockets, no threads.

    world = World(folder)                          # the rover boots with the first step
    world.happen(At("sweep", 1.0), hole(3.6))      # see virtual_faults
    with Link.open("virtual:", tlog, line=VirtualLine(world)) as link: ...
    world.record                                   # what really happened

The world moves on in main loops of 20 ms, and only while the laptop waits: code that does not wait takes
no time. The laptop's monotonic clock stops while it sleeps; its wall clock and its clock since boot go on.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, get_args

from virtual_pipe import Frame, Pipe
from virtual_record import Record, Row, Sent
from virtual_rover import LOOP_US, PARAMETERS, VirtualRover

Phase = Literal[
    "connecting",
    "uploading",
    "arming",
    "standing",
    "waiting",
    "straight",
    "sweep",
    "after",
    "standing after",
    "letting go",
]
PHASES: tuple[Phase, ...] = get_args(Phase)
# SWP_ST: stand still, wait for speed, straight, fade-in, dwell, law, fade-out, straight, stand still
_OF_STATE: Mapping[int, Phase] = {
    1: "standing",
    2: "waiting",
    3: "straight",
    6: "sweep",
    8: "after",
    9: "standing after",
}
_THROTTLE, _SWITCH = 2, 5  # RC channels, 0-based
_REACHES = 0.3  # s within which what the laptop sends must come through to count as reaching the vehicle
_SETTLED = 50  # main loops that a disarmed rover stands without a frame on its way to it
_OVERRIDE, _NAMED_FLOAT = 70, 251  # message numbers
WALL_0, SINCE_BOOT_0, MONOTONIC_0 = 1_700_000_000.0, 5000.0, 1000.0


class Killed(BaseException):
    """The laptop's program has died: whatever catches this can send nothing any more."""


class Overran(BaseException):
    """The scenario took longer than its limit; the laptop is dead from then on."""


@dataclass(frozen=True)
class At:
    """So many virtual seconds after the phase was first entered. "letting go": the applet ended its run."""

    phase: Phase
    seconds: float = 0.0


Change = Callable[["World"], None]


@dataclass(frozen=True)
class Fault:
    """Something that happens to the world. begin: what it changes; end: called `seconds` later."""

    name: str
    begin: Change
    seconds: float = float("inf")
    end: Change | None = None


@dataclass
class Laptop:
    """What the harness knows of the computer. death: raised in the program at its next receive or send, as is
    interrupt, once; signal: its number is sent to this process then, once.

    heard, state_heard: world's time [s] at which it last read a whole frame of the vehicle, and SWP_ST.
    """

    slept_us: int = 0
    wakes_us: int = 0
    wall_jump: float = 0.0
    queues: bool = True
    death: BaseException | None = None
    interrupt: BaseException | None = None
    signal: int = 0
    disk_full: bool = False
    heard: float = float("-inf")
    state_heard: float = float("-inf")


@dataclass
class _Planned:
    at: At
    fault: Fault
    ends_us: int | None = None


@dataclass
class World:
    """See above. settings: parameters of the vehicle before its first boot; limit: s until `Overran`.

    The connection outlives a reboot of the vehicle, as by radio."""

    folder: Path
    settings: Mapping[str, float] = field(default_factory=dict)
    seed: int = 1
    limit: float = 120.0

    def __post_init__(self) -> None:
        self.now_us = 0
        self.laptop, self.record = Laptop(), Record()
        self.down, self.up = Pipe(2 * self.seed), Pipe(2 * self.seed + 1)
        self.entered: dict[Phase, int] = {}
        self.connections, self.connected = 0, False
        self.each_step: list[Change] = []
        self._plan: list[_Planned] = []
        settings = PARAMETERS | dict(self.settings)
        self.vehicle = VirtualRover(self.folder, settings, self.seed, self._from_vehicle)
        self.vehicle.on_text = lambda text: self.record.texts.append((self.now, text))
        self.vehicle.on_state = self._state

    @property
    def now(self) -> float:
        """s since the world began; the rover boots at 0."""
        return self.now_us * 1e-6

    def happen(self, at: At, fault: Fault) -> None:
        """Let `fault` begin at that moment."""
        self._plan.append(_Planned(at, fault))

    def instead(self, fault: Fault) -> None:
        """Let `fault` begin now, in place of the only one that was planned."""
        (planned,) = self._plan
        planned.fault = fault
        fault.begin(self)

    def enter(self, phase: Phase) -> None:
        """The laptop's own phases are told by whoever runs its program; those of the applet are seen."""
        self.entered.setdefault(phase, self.now_us)

    def step(self) -> None:
        """One main loop of the vehicle, and what happens meanwhile."""
        self.now_us += LOOP_US
        if self.now > self.limit and self.laptop.death is None:
            self.laptop.death = Overran(f"not ended after {self.limit:g} s")
        self._faults()
        received = [frame.data for frame in self.up.take(self.now_us)]
        self.vehicle.step(received, listened_to=self.connected and self.laptop.death is None)
        for change in self.each_step:
            change(self)
        self._write_row()

    def run(self, seconds: float) -> None:
        """The world goes on without the laptop."""
        until_us = self.now_us + round(seconds * 1e6)
        while self.now_us < until_us:
            self.step()

    def settle(self, seconds: float) -> None:
        """As `run`, after the laptop's program has ended: until nothing is left that could move the rover."""
        until_us, still = self.now_us + round(seconds * 1e6), 0
        while self.now_us < until_us and still < _SETTLED:
            self.step()
            rover = self.vehicle.rover
            asleep = rover is not None and not rover.armed and not self.each_step and self.up.empty
            still = still + 1 if asleep else 0

    # ---- the laptop's end of the link

    def connect(self) -> None:
        """A new connection; nothing of an older one comes out of it."""
        self.connections, self.connected = self.connections + 1, True
        self.down.clear()
        self.up.clear()
        self.vehicle.connect()

    def cut(self) -> None:
        """The connection is closed by the other side."""
        self.connected = False

    def take(self) -> bytes:
        """What the laptop reads now."""
        frames = self.down.take(self.now_us)
        for frame in frames:
            self._read(frame)
        return b"".join(frame.data for frame in frames)

    def send(self, data: bytes) -> None:
        """What the laptop sends now."""
        if int.from_bytes(data[7:10], "little") == _OVERRIDE:
            self._write_override(struct.unpack_from("<8H", data[10 : 10 + data[1]].ljust(64, b"\0")))
        self.up.put(data, self.now_us)

    # ---- within

    def _from_vehicle(self, data: bytes) -> None:
        laptop = self.laptop
        kept = laptop.queues or self.now_us >= laptop.wakes_us
        if self.connected and laptop.death is None and kept:
            self.down.put(data, self.now_us)

    def _read(self, frame: Frame) -> None:
        if not (frame.whole and frame.own):
            return
        laptop = self.laptop
        laptop.heard = self.now
        data = frame.data
        if data[7] == _NAMED_FLOAT and not data[8] and data[18:24] == b"SWP_ST":
            laptop.state_heard = self.now

    def _faults(self) -> None:
        for planned in tuple(self._plan):
            began_us = self.entered.get(planned.at.phase)
            if planned.ends_us is None:
                if began_us is None or self.now_us < began_us + round(planned.at.seconds * 1e6):
                    continue
                planned.fault.begin(self)
                seconds = min(planned.fault.seconds, 1e6)
                planned.ends_us = self.now_us + round(seconds * 1e6)
            elif self.now_us >= planned.ends_us:
                self._plan.remove(planned)
                if planned.fault.end is not None:
                    planned.fault.end(self)

    def lift(self) -> None:
        """All faults that are under way end now, and those that have not begun never do."""
        for planned in self._plan:
            if planned.ends_us is not None and planned.fault.end is not None:
                planned.fault.end(self)
        self._plan = []

    @property
    def begun(self) -> bool:
        """Whether every planned fault has begun."""
        return all(planned.ends_us is not None for planned in self._plan)

    def _state(self, state: int) -> None:
        active = self.record.rows and 0 < self.record.rows[-1].state < 10
        if state in (1, 2, 3) and not active:
            self.record.begun.append((self.now, self._run_number()))
        if state in _OF_STATE:
            self.enter(_OF_STATE[state])
        elif state in (0, 10) and active:
            self.enter("letting go")

    def _run_number(self) -> int:
        rover = self.vehicle.rover
        assert rover is not None
        return int(rover.parameters["SWP_RUN"])

    def _write_override(self, us: tuple[int, ...]) -> None:
        laptop, now = self.laptop, self.now
        ages = now - laptop.heard, now - laptop.state_heard
        self.record.sent.append(Sent(now, us[_THROTTLE], us[_SWITCH], *ages))

    def _write_row(self) -> None:
        vehicle, laptop, rover = self.vehicle, self.laptop, self.vehicle.rover
        awake = laptop.death is None and self.now_us >= laptop.wakes_us
        up = self.up.weather
        in_time = up.delay + up.jitter < _REACHES and not (up.hole or up.stall)
        reached = laptop.heard, awake and self.connected and in_time
        if rover is None:
            rows = Row(self.now, vehicle.boots, 0.0, 0.0, 0.0, 0, False, 0, vehicle.run, *reached)
        else:
            at, throttle = rover.plant.state, rover._actuators()[1]
            applet = vehicle.state, vehicle.run
            rows = Row(self.now, vehicle.boots, at.vx, at.x, at.y, throttle, rover.armed, *applet, *reached)
        self.record.rows.append(rows)
