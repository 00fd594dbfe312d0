"""Runs the drive code in a virtual world and says what came of it.

    outcome = played(tmp_path, [(At("sweep", 1.0), hole(3.6))])
    assert outcome.record.begun ... outcome.error ... outcome.said

`played` drives `vehicle.run.one_run` once, with the right to arm, to throw the switch and (throttle_us) to
drive; `session_played` drives `session.drive`. Afterwards the faults under way go on, then they are lifted.
"""

from __future__ import annotations

import errno
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from unittest import mock

import pytest
from virtual_line import VirtualLine
from virtual_record import Record
from virtual_world import At, Fault, Killed, Overran, World

from firmware_params.applet_parameters import applet_source
from rover_sweep.errors import RoverSweepError
from rover_sweep.manoeuvre.sweep import Manoeuvre, Sweep
from rover_sweep.session.content import SessionRun
from rover_sweep.session.session import SessionPlan, drive, start_streams
from rover_sweep.vehicle.events import Event, Interrupted, Notice, RunFinished, RunStarted
from rover_sweep.vehicle.link import recorded_transport as recorder
from rover_sweep.vehicle.link.connection import Access
from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.run.controls import RunSettings
from rover_sweep.vehicle.run.one_run import one_run
from sitl import embedded

SWEEP = Sweep(amplitude=100, w_min=3, w_max=20, t_rec=8, fade=0.5, dwell=0.5, straight=1)
LIMITS = {"gcs": 1.0, "v_min": 1.0, "v_max": 5.0, "still": 1.0}
SETTINGS = RunSettings(arm=True, throttle_us=1710, trigger="override", extra=LIMITS)
BOOT = 11.0  # s until the embedded rover has a velocity (sitl.autopilot.rover.ORIGIN_MS)
AFTER, BACK = 30.0, 10.0  # s

Happening = tuple[At, Fault]


@dataclass(frozen=True)
class Outcome:
    """What came of a scenario. asked: runs that somebody said yes to; error: what the drive code raised
    (RoverSweepError, KeyboardInterrupt, Killed, Overran); ended: world's time [s] at which it returned or
    raised; fired: all faults had begun by then."""

    world: World
    events: tuple[Event, ...]
    error: BaseException | None
    asked: int
    ended: float
    fired: bool

    @property
    def record(self) -> Record:
        return self.world.record

    @property
    def finished(self) -> RunFinished | None:
        """The run's last event, None where it did not come to one."""
        return next((e for e in reversed(self.events) if isinstance(e, RunFinished)), None)

    @property
    def said(self) -> str:
        """What the tool itself told its user, a line each; without what the vehicle says."""
        told = [e.text for e in self.events if isinstance(e, Notice)]
        told += [f for e in self.events if isinstance(e, Interrupted) for f in e.failures]
        told += [e.reason for e in self.events if isinstance(e, RunFinished)]
        error = [] if self.error is None else [str(self.error), *getattr(self.error, "__notes__", ())]
        return "\n".join((*told, *error))

    @property
    def armed(self) -> bool:
        """Whether the rover is armed at the very end."""
        return self.record.rows[-1].armed

    @property
    def left_armed(self) -> bool:
        """Whether the rover was armed when the drive code ended."""
        return next(row.armed for row in reversed(self.record.rows) if row.t <= self.ended + 1e-9)

    @property
    def killed(self) -> bool:
        return isinstance(self.error, Killed)

    @property
    def overran(self) -> bool:
        return isinstance(self.error, Overran)

    @property
    def unasked(self) -> int:
        """Runs that the applet began and nobody asked for."""
        return max(0, len(self.record.begun) - self.asked)

    def sent_late(self, of: Callable[..., float] = lambda sent: sent.heard) -> float:
        """Longest time [s] since the vehicle was heard (or: sent.state_heard) at which the tool
        still sent a throttle above trim; 0 where it sent none."""
        return max((of(sent) for sent in self.record.sent if sent.driving), default=0.0)

    def again_high(self) -> bool:
        """Whether the switch was sent high again after it had been let go."""
        highs = [sent.high for sent in self.record.sent if sent.switch != 0xFFFF]
        changes = [b for a, b in zip(highs, highs[1:], strict=False) if a != b]
        return changes.count(True) > self.asked

    def misreported(self) -> str:
        """How the tool's words differ from what the applet did; '' where they do not."""
        finished, completed = self.finished, set(self.record.completed)
        if finished is None:
            return ""
        begun = [number for _, number in self.record.begun]
        first = begun[0] if begun else None
        if finished.completed and first not in completed:
            why = self.record.stopped.get(first or 0, "it did not end")
            return f"run {first} is called completed, but: {why}"
        if finished.completed and finished.number != first:
            return f"run {first} was asked for, run {finished.number} is reported"
        if not finished.completed and first in completed:
            return f"run {first} came to its end and is called {finished.reason}"
        return ""


def played(
    folder: Path,
    happenings: Sequence[Happening] = (),
    *,
    settings: RunSettings = SETTINGS,
    manoeuvre: Manoeuvre = SWEEP,
    limit: float = 90.0,
    seed: int = 1,
    after: float = AFTER,
    back: float = BACK,
    access: Access | None = None,
) -> Outcome:
    """One run. limit: s of the world until `Overran`. after, back: how long the world goes on with the faults
    and without them, unless the rover has come to rest."""
    world = World(folder / "vehicle", seed=seed, limit=limit)
    for at, fault in happenings:
        world.happen(at, fault)
    world.run(BOOT)

    def program() -> Iterator[Event]:
        world.enter("connecting")
        with Link.open("virtual:", folder / "connect.tlog", line=VirtualLine(world), access=access) as link:
            for _ in start_streams(link):  # what it says of the rates is not of this run
                pass
            world.enter("uploading")
            yield from one_run(link, manoeuvre, "sweep1", folder / "sweep1.tlog", settings)

    return _outcome(world, program(), asked=1, after=after, back=back)


def session_played(
    folder: Path,
    happenings: Sequence[Happening] = (),
    *,
    runs: int = 1,
    after: float = AFTER,
    back: float = BACK,
) -> Outcome:
    """A whole session of so many runs into folder/session, from the rover's boot on; a yes for each run."""
    world = World(folder / "vehicle", limit=200.0)
    for at, fault in happenings:
        world.happen(at, fault)
    world.enter("connecting")
    planned = tuple(SessionRun(f"sweep{n}", SWEEP) for n in range(1, runs + 1))
    plan = SessionPlan(planned, SETTINGS, logs=False)
    program = drive("virtual:", folder / "session", plan, VirtualLine(world))
    return _outcome(world, program, asked=runs, after=after, back=back)


def applet_without(monkeypatch: pytest.MonkeyPatch, folder: Path, *changes: tuple[str, str]) -> None:
    """From now on rovers boot with the applet in which each `old` is its `new`, kept in that folder."""
    source = applet_source()
    for old, new in changes:
        assert source.count(old) == 1, old
        source = source.replace(old, new)
    changed = folder / embedded.APPLET.name
    changed.write_text(source, encoding="utf-8")
    monkeypatch.setattr(embedded, "APPLET", changed)


def _outcome(world: World, program: Iterator[Event], asked: int, after: float, back: float) -> Outcome:
    events, error = list[Event](), None
    with _disk(world):
        try:
            for event in program:
                events.append(event)
                if isinstance(event, RunStarted):
                    world.enter("arming")
        except (RoverSweepError, KeyboardInterrupt, Killed, Overran) as raised:
            error = raised
    fired, ended = world.begun, world.now
    world.laptop.death = world.laptop.death or Killed()
    world.settle(after)
    world.lift()
    world.settle(back)
    return Outcome(world, tuple(events), error, asked, ended, fired)


@contextmanager
def _disk(world: World) -> Iterator[None]:
    """The recorder's disk is full while the world says so."""
    write = recorder._write_all

    def written(file: object, data: bytes) -> None:
        if world.laptop.disk_full and data:
            raise OSError(errno.ENOSPC, "No space left on device")
        write(file, data)  # type: ignore[arg-type]

    with mock.patch.object(recorder, "_write_all", written):
        yield
