"""One run through a link that fails, on the official firmware; what came of it, and what it breaks.

As a program it drives one run at a URL and is there to be killed: python firmware_faults.py URL FOLDER
"""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from firmware_observer import Observer, Seen
from firmware_relay import Relay, Sent

from firmware_params.applet_parameters import applet_path
from firmware_params.param_files import shipped
from rover_sweep.errors import RoverSweepError
from rover_sweep.manoeuvre.sweep import Sweep
from rover_sweep.session.session import await_estimator, start_streams
from rover_sweep.vehicle.events import Event, Notice, RunFinished
from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.run.controls import RunSettings, pump
from rover_sweep.vehicle.run.one_run import one_run
from sitl.launcher import start_ardurover
from sitl.transmitter import Transmitter

SWEEP = Sweep(amplitude=100, w_min=3, w_max=20, t_rec=10, fade=0.5, dwell=0.5, straight=1)
LIMITS: Mapping[str, float] = {"gcs": 1.0, "v_min": 1.0, "v_max": 5.0, "still": 1.0}
THROTTLE = 1710  # us, 2.5 m/s
SWEEPING, INTO = 6, 1.0  # SWP_ST; s
BACK = 10.0  # s with the link as it was, after the run
FARTHEST, HOLD, ASLEEP = 12.0, 4, 15.0  # m after a laptop is lost; mode; s
MAY_BE_LATE, OVERRIDE_HOLDS = 1.0, 1.5  # s, as in tests/virtual
WINDS_DOWN = 0.55  # s from 1710 us to trim: 52 % at MOT_SLEWRATE's 100 %/s, and a message in flight


@dataclass(frozen=True)
class Rig:
    relay: Relay
    observer: Observer
    radio: Transmitter


@dataclass(frozen=True)
class Scenario:
    """fault: begins INTO s of the sweep, where there is one. lifts: s later it ends by itself. lapses:
    nothing that is sent arrives. drives: s of throttle that the run itself may take, without a fault. told: a
    regular expression for what the program says of the run. killed, asleep: the program, in a process of its
    own, is killed, or stands still for ASLEEP s. lost: the rover must be in HOLD or disarmed in the end,
    within FARTHEST m."""

    name: str
    fault: Callable[[Rig], None] | None
    told: str
    lifts: float | None = None
    lapses: bool = False
    killed: bool = False
    asleep: bool = False
    lost: bool = False
    drives: float = 0.0
    throttle: int = THROTTLE
    limits: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Outcome:
    """since: time of the fault, or of the run's first throttle where there is none. heard: when the program
    last had anything to read, of that before the rover stopped."""

    seen: Seen
    sent: list[Sent]
    since: float
    finished: RunFinished | None
    said: str
    armed: bool
    killed: bool
    mode: int = 0

    @property
    def wound_down(self) -> float:
        """s from the first override at trim or released after the fault to the last throttle off trim."""
        let_go = (s.t for s in self.sent if s.t > self.since and not s.driving and s.throttle != 0xFFFF)
        return self.seen.last_driven() - next(let_go, float("nan"))

    def row(self, name: str) -> str:
        """For the table: driven since the fault, and of that after it was let go; metres; sent how late."""
        late = max((s.heard for s in self.sent if s.driving), default=0.0)
        cells = (
            name,
            f"{self.seen.driven_after(self.since):.2f} s",
            f"{self.wound_down:.2f} s",
            f"{self.seen.metres_after(self.since):.1f} m",
            f"{late:.2f} s",
            f"{len(self.seen.begun)}",
            f"mode {self.mode}",
            self.said.splitlines()[-1] if self.said else "killed",
            "yes" if self.armed else "no",
        )
        return f"| {' | '.join(cells)} |"


@contextmanager
def booted(binary: Path, home: Path) -> Iterator[Rig]:
    """The firmware with its applet, its EKF ready, behind a relay and under observation."""
    defaults = [shipped("identification")]
    with (
        start_ardurover(binary, home, defaults=defaults, scripts=[applet_path()]) as running,
        Relay(running.connection) as relay,
        Observer(running.connection) as observer,
    ):
        with Link.open(relay.url, home / "boot.tlog", timeout=60.0) as link:
            list(start_streams(link))
            list(await_estimator(link))
        assert running.radio is not None
        radio = Transmitter(running.radio)
        yield Rig(relay, observer, radio)
        radio.close()


def played(rig: Rig, scenario: Scenario, folder: Path) -> Outcome:
    """One run with the fault, and BACK s after it."""
    rest(rig)
    rig.relay.begin()
    rig.observer.begin()
    began = list[float]()

    def fault() -> None:
        assert scenario.fault is not None
        began.append(time.monotonic())
        scenario.fault(rig)
        if scenario.lifts is not None:
            rig.observer.after(scenario.lifts, lambda: rig.relay.set("open"))

    if scenario.fault is not None:
        rig.observer.at(SWEEPING, INTO, fault)
    drive = _apart if scenario.killed or scenario.asleep else _driven
    finished, said, armed = drive(rig, scenario, folder, began)
    since = began[0] if began else next((row.t for row in rig.observer.seen.rows if row.driving), 0.0)
    apart = scenario.killed or scenario.asleep
    return Outcome(rig.observer.seen, rig.relay.sent, since, finished, said, armed, apart, rig.observer.mode)


def _driven(
    rig: Rig, scenario: Scenario, folder: Path, began: list[float]
) -> tuple[RunFinished | None, str, bool]:
    """In this process; after its end the link goes on for BACK s. Armed: when the run ended."""
    settings = RunSettings(True, scenario.throttle, "override", {**LIMITS, **scenario.limits})
    events, errors = list[Event](), list[str]()
    with Link.open(rig.relay.url, folder / "connect.tlog") as link:
        list(start_streams(link))
        try:
            events.extend(one_run(link, SWEEP, "sweep1", folder / "sweep1.tlog", settings))
        except RoverSweepError as error:
            errors += [*getattr(error, "__notes__", ()), str(error)]
        rig.observer.wait(0.5)
        armed = rig.observer.armed
        rig.relay.set("open")
        try:
            pump(link, BACK, wall_limit=BACK)
        except RoverSweepError:
            rig.observer.wait(BACK)
    finished = next((e for e in events if isinstance(e, RunFinished)), None)
    told = [e.text for e in events if isinstance(e, Notice)]
    told += [finished.reason] if finished else []
    return finished, "\n".join((*told, *errors)), armed


def _apart(rig: Rig, scenario: Scenario, folder: Path, began: list[float]) -> tuple[None, str, bool]:
    """In a process of its own, which the fault kills, or stops for a while."""
    program = subprocess.Popen(
        [sys.executable, __file__, rig.relay.url, str(folder)], stderr=subprocess.PIPE, text=True
    )
    try:
        assert rig.observer.wait(90.0, lambda: bool(began)), "no sweep began"
        if scenario.asleep:
            program.send_signal(signal.SIGSTOP)
            rig.observer.wait(ASLEEP)
            program.send_signal(signal.SIGCONT)
            _, said = program.communicate(timeout=60.0)
            return None, said.strip().rpartition("\n")[2], rig.observer.armed
        program.send_signal(signal.SIGKILL)
    finally:
        program.kill()
        program.wait()
    rig.observer.wait(BACK)
    return None, "", rig.observer.armed


def rest(rig: Rig) -> None:
    """Disarmed, standing, with a radio, an applet, and parameters as at the start."""
    observer = rig.observer
    rig.relay.set("open")
    observer.command("MAV_CMD_COMPONENT_ARM_DISARM", 0.0, 21196.0)
    for name, value in {"SIM_RC_FAIL": 0.0, "RC_OVERRIDE_TIME": 3.0, "SWP_LAPSE": 0.0}.items():
        observer.set(name, value)
    observer.wait(0.5)
    rig.radio.hold(1, 1500)
    rig.radio.hold(3, 1500)  # the channels keep the values of SIM_RC_FAIL 2 until a transmitter is heard
    if observer.seen.said("SWP:") and observer.state not in (0, 10):
        observer.command("MAV_CMD_SCRIPTING", 3.0)
        observer.wait(15.0, lambda: bool(observer.seen.said("SWP: applet")))
    observer.wait(1.0)
    assert observer.wait(30.0, lambda: not observer.armed and observer.speed < 0.15), "no rest"


def broken(outcome: Outcome, scenario: Scenario) -> list[str]:
    """A sentence for each promise that was not kept."""
    found = [*_asked(outcome), *_stopped(outcome, scenario), *_reported(outcome)]
    return [*found, *(_held(outcome) if scenario.lost else ())]


def _held(outcome: Outcome) -> Iterator[str]:
    if (metres := outcome.seen.metres_after(outcome.since)) > FARTHEST:
        yield f"it moved {metres:.1f} m after the laptop was lost"
    if outcome.armed and outcome.mode != HOLD:
        yield f"it is armed in mode {outcome.mode}"


def _asked(outcome: Outcome) -> Iterator[str]:
    if len(outcome.seen.begun) > 1:
        yield f"the applet began runs {outcome.seen.begun}, one was asked for"
    highs = [sent.high for sent in outcome.sent]
    if [b for a, b in zip(highs, highs[1:], strict=False) if a != b].count(True) > 1:
        yield "the switch was sent high again"


def _stopped(outcome: Outcome, scenario: Scenario) -> Iterator[str]:
    late = max((s.heard for s in outcome.sent if s.driving or s.high), default=0.0)
    if late > MAY_BE_LATE:
        yield f"throttle or switch was sent {late:.2f} s after the rover was last heard"
    limit = scenario.drives + MAY_BE_LATE + WINDS_DOWN + (OVERRIDE_HOLDS if scenario.lapses else 0.0)
    driven = outcome.seen.driven_after(outcome.since)
    if driven > limit:
        yield f"the rover was driven for {driven:.2f} s, {limit:.1f} s at most are promised"


def _reported(outcome: Outcome) -> Iterator[str]:
    done = bool(outcome.seen.said(f"SWP: run {(outcome.seen.begun or [0])[0]} done"))
    if outcome.finished is not None and outcome.finished.completed != done:
        yield f"called {outcome.finished.reason!r}, while the applet's run was {'' if done else 'not '}done"
    if outcome.armed and not outcome.killed and "may still be armed" not in outcome.said:
        yield f"the rover was left armed, and that was not said: {outcome.said!r}"


if __name__ == "__main__":
    _url, _folder = sys.argv[1], Path(sys.argv[2])
    with Link.open(_url, _folder / "connect.tlog") as _link:
        list(start_streams(_link))
        _settings = RunSettings(True, THROTTLE, "override", LIMITS)
        list(one_run(_link, SWEEP, "sweep1", _folder / "sweep1.tlog", _settings))
