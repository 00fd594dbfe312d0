"""Every screen in every state worth looking at: what was told and which keys were pressed up to there."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping, Sequence
from contextlib import asynccontextmanager
from dataclasses import replace
from functools import wraps
from inspect import signature
from pathlib import Path
from typing import Any
from unittest import mock

from scripted_source import (
    CHECKS,
    SWEEP,
    TLOG,
    URL,
    VERDICT,
    ScriptedSource,
    connected,
    drive,
    finished,
    snapshot,
    under_way,
)
from textual.pilot import Pilot

from rover_sweep.data.vehicle_file import load
from rover_sweep.live.source import Checked, Connect, Ended, Judged, Lost, Played, Preflight, Update, Verdict
from rover_sweep.live.verdict import stopped_verdict
from rover_sweep.manoeuvre.sweep import ThrottleSweep
from rover_sweep.session.session import SessionRun
from rover_sweep.tui.app import SweepApp
from rover_sweep.tui.jobs import AnalysisJob
from rover_sweep.tui.model.setup import Setup
from rover_sweep.vehicle import events as e
from rover_sweep.vehicle.link.inbox import LinkQuality
from rover_sweep.vehicle.run.controls import RunSettings

ROVER_FILE = Path(__file__).parents[1] / "data" / "rover.toml"
SETUP = Setup(url=URL, folder=Path("session"), vehicle_path=ROVER_FILE, vehicle=load(ROVER_FILE))
OWN = RunSettings(arm=True, throttle_us=1710, trigger="override")

Step = str | Sequence[Update]  # a key, or what the source tells
Then = Callable[..., Awaitable[None]]

_READY: tuple[Step, ...] = ("enter", connected(), [Ended(Preflight())])
_DRIVEN: tuple[Step, ...] = (*_READY, "3", "g", under_way())
FAST: tuple[Update, ...] = (
    e.RunFinished("sweep1", False, "speed 4.0 > 4 m/s", TLOG, (4.0, 20.0), 1, ()),
    snapshot(20.0, state=0, state_name="idle", armed=False, switch=1000.0, speed=0.1),
    Ended(drive(settings=OWN)),
    Judged(stopped_verdict(SessionRun("sweep1", SWEEP, 2.0), "speed 4.0 > 4 m/s", TLOG, 1710, 1500)),
)
_KEEP = Verdict("sweep1", "keep", "keep: coherence >= 0.6 over 0.3-25 rad/s", VERDICT.bands[:4])
_ASKED: tuple[Step, ...] = (*_READY, "3", "g", [e.RunStarted("sweep1", SWEEP, TLOG)])
_THROTTLE = [
    e.RunStarted("throttle1", ThrottleSweep(amplitude=30), TLOG),
    e.Armed(3.0),
    e.StateChanged(9.0, 6, "manoeuvre"),
    *(snapshot(9.0 + 0.1 * n, pwm=1500.0, r=0.0, ay=0.0, phi=0.0, p=0.0) for n in range(60)),
]
_FAR = snapshot(2.0, state=0, state_name="idle", pwm=1500.0, r=0.0, ay=0.0, phi=0.0, speed=0.0, switch=1000.0)
_POOR = LinkQuality(seconds=12.0, frames=900, lost=0.52).words

SCENES: Mapping[str, tuple[Step, ...]] = {
    "connect": (),
    "connect-typing": ("u",),
    "connect-failed": (
        "enter",
        [Ended(Connect(URL), "cannot open tcp:127.0.0.1:5760: Connection refused; does it run?")],
    ),
    "preflight": _READY,
    "preflight-reboot": (*_READY, "down", "f"),
    "preflight-again": (*_READY, "r"),
    "preflight-good": (*_READY, [Checked(tuple(c for c in CHECKS if c.state == "good"))]),
    "plan": (*_READY, "3", "down", "m", "b"),
    "plan-throttle": (*_READY, "3", "h"),
    "plan-empty": (*_READY, "3", "x", "x", "x"),
    "plan-edit": (*_READY, "3", "e", "down", "right"),
    "run-idle": (*_READY, "4"),
    "run-arm": (*_ASKED, [replace(_FAR, armed=False)]),
    "run-switch-high": (*_ASKED, [e.Armed(2.0), e.SwitchWanted("high", 6), _FAR]),
    "run-steers": _DRIVEN,
    "run-throttle": (*_READY, "3", "h", "g", _THROTTLE),
    "run-poor-link": (*_DRIVEN, [snapshot(15.0, link=_POOR)]),
    "run-aborting": (*_DRIVEN, "space"),
    "run-lost": (*_DRIVEN, [Lost("nothing was heard of the rover for 3 s.")]),
    "run-switch-low": (*_DRIVEN, [e.SwitchWanted("low", 6), snapshot(75.0, state=0, state_name="idle")]),
    "run-hold": (*_READY, "4", [snapshot(75.0, state=0, state_name="idle", mode=4, armed=True)]),
    "run-played": ([Played(34.0, 120.0, 2.0), *under_way()], "4"),
    "verdict": (*_DRIVEN, finished()),
    "verdict-keep": (*_DRIVEN, [*finished()[:-1], Judged(_KEEP)]),
    "log": (*_DRIVEN, finished(), "6"),
    "results": (*_DRIVEN, finished(), "7"),
    "results-gains": (*_DRIVEN, finished(), "7"),
}

OWN_SCENES: Mapping[str, tuple[Step, ...]] = {
    "run-consent": (*_READY, "3", "g"),
    "run-throttle-consent": (*_READY, "3", "h", "g"),
    "run-kept-consent": (
        *(*_READY, "3", "g", "y", under_way()),
        [*finished()[:3], Ended(drive(settings=OWN)), Judged(_KEEP)],
        *("3", "up", "g"),
    ),
    "verdict-too-fast": (*_READY, "3", "g", "y", [*under_way(), *FAST], "5"),
}

JOBS = (
    AnalysisJob(
        "identify",
        ("identify", "session", "--out", "session/report"),
        Path("session/report"),
        "done",
        ("report: session/report/report.html",),
        seconds=15.2,
        page=Path("session/report/report.html"),
        summary=(
            "use the roll-yaw model: J_ave 6.2, hardly distinguishable from the data (guideline <= 50)",
            "roll-yaw (recommended): C 30.4 N/rad, Izz 0.0684 kg m^2, tau 0.0438 s",
        ),
    ),
    AnalysisJob(
        "diagnose",
        ("diagnose", "session", "--out", "session/diagnosis"),
        Path("session/diagnosis"),
        lines=("reading session",),
        seconds=4.0,
    ),
)

GAINS = AnalysisJob(
    "gains",
    ("gains", "session/report"),
    Path("session/gains.param"),
    "done",
    (
        "Gains for 2.23 m/s, valid from 1.48 to 3.34 m/s (roll-yaw model, good).",
        "",
        "                                            now            proposed  ",
        *(
            f"{name:<28}{now:>19}{proposed:>20}  "
            for name, now, proposed in (
                ("ATC_STR_RAT_FF", "0.2", "0.977"),
                ("ATC_STR_RAT_P", "0.2", "0.371"),
                ("ATC_STR_RAT_I", "0.2", "1.655"),
                ("ATC_STR_RAT_D", "0", "0"),
                ("ATC_STR_RAT_IMAX", "1", "0.75"),
                ("gain margin", "22.8 dB", "16.7 dB"),
                ("phase margin", "99 deg", "98 deg"),
                ("bandwidth of r / target", "0.196 rad/s", "26.1 rad/s"),
                ("step of 34 deg/s: rise", "never", "0.222 s"),
                ("  overshoot", "0.0 %", "5.0 %"),
            )
        ),
        "note: at 2.23 m/s the steering reaches its stops at 119 deg/s, but the firmware allows targets up "
        "to 120 deg/s: lower ATC_STR_RAT_MAX",
        "parameters written to session/gains.param",
    ),
    seconds=8.0,
)
WORKED_OUT = {"results": JOBS, "results-gains": (*JOBS[:1], GAINS)}


@asynccontextmanager
async def playing(
    steps: Sequence[Step], size: tuple[int, int] = (80, 24), setup: Setup = SETUP
) -> AsyncIterator[tuple[SweepApp, ScriptedSource, Pilot[None]]]:
    """The application after these steps."""
    source = ScriptedSource()
    app = SweepApp(source, setup)
    async with app.run_test(size=size) as pilot:
        await pilot.pause()
        for step in steps:
            if isinstance(step, str):
                await pilot.press(step)
            else:
                _arrived(app, source, step)
            await pilot.pause()
        yield app, source, pilot


def played(
    steps: Sequence[Step], setup: Setup = SETUP, size: tuple[int, int] = (80, 24)
) -> Callable[[Then], Callable[..., None]]:
    """Makes a test of an `async def test(app, source, pilot, ...)` that goes on after these steps."""

    def made(then: Then) -> Callable[..., None]:
        @wraps(then)
        def test(**given: Any) -> None:
            async def run() -> None:
                async with playing(steps, size, setup) as (app, source, pilot):
                    await then(app, source, pilot, **given)

            asyncio.run(run())

        asked = signature(then)
        rest = [p for name, p in asked.parameters.items() if name not in ("app", "source", "pilot")]
        test.__signature__ = asked.replace(parameters=rest)  # type: ignore[attr-defined]
        return test

    return made


def after(steps: Sequence[Step], then: Then, setup: Setup = SETUP) -> None:
    """Plays the steps, then what the test does."""
    played(steps, setup)(then)()


def _arrived(app: SweepApp, source: ScriptedSource, step: Sequence[Update]) -> None:
    """All of them reach the state one by one; they are drawn once."""
    with mock.patch.object(app, "redraw"):
        for told in step:
            source.tell(told)
            app.on_arrived()
    app.redraw()


def all_scenes() -> dict[str, tuple[Sequence[Step], Setup]]:
    """Name: steps, and what the command line said."""
    own = replace(SETUP, settings=OWN)
    return {name: (steps, SETUP) for name, steps in SCENES.items()} | {
        name: (steps, own) for name, steps in OWN_SCENES.items()
    }
