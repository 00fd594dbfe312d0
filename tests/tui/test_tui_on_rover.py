"""A whole session by keys alone: the application as the command line makes it, on the embedded rover."""

from __future__ import annotations

import asyncio
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from by_keys import Person, application, using

from firmware_params.applet_parameters import applet_version
from rover_sweep.session.folder import read_folder as read_session
from rover_sweep.vehicle.events import RunFinished
from sitl import launcher
from tests.vehicle.simulated_drive import PARAMETERS

ROVER_FILE = Path(__file__).parents[1] / "data" / "rover.toml"
OWN = ("--arm", "--throttle", "1710", "--throw-switch")
LIMITS = tuple(f"--limit={limit}" for limit in ("v_min=1", "v_max=5", "still=1"))
REPEATS = 3  # a machine whose processors are all busy keeps the rover silent for more than a second
SILENT = ("nothing was heard from the rover", "the applet has not reported its state")
DISARMED = "disarmed"  # the program disarms a rover that it does not hear
VERDICT_WITHIN = 15.0  # s: it takes 0.4 s of a processor, which others may be using meanwhile


@pytest.fixture
def rover(tmp_path: Path) -> Iterator[launcher.Running]:
    """With the parameters for an identification, and without the applet.

    No faster than it must be: while the program works something out, the rover would use a whole core.
    """
    with launcher.start_embedded(tmp_path / "vehicle", options=PARAMETERS, speedup=10) as running:
        yield running


async def shorter(person: Person, amplitude: int) -> None:
    """The chosen row as a sweep of 10 s, typed in."""
    await person.press("e")
    await person.until("highest frequency", "or type the number")
    await person.press(*str(amplitude), "down", *"2.5", "down", "2", "down", *"20", "down", *"10")
    await person.until("10_ s")
    await person.press("enter")


async def driven(person: Person, name: str) -> None:
    """Drives the next row with consent, up to its verdict."""
    for _ in range(REPEATS):
        await person.press("g")
        await person.until(f"{name}: ", "This program arms the rover", "Is the area clear")
        await person.press("y")
        await person.until("[4 RUN]", "SPACE or ESC")
        seen = await person.when(lambda: _judged(person.screen, name), f"the verdict on {name}", seconds=120)
        if not _busy(person.screen):
            break
    await person.when(lambda: _titled(person.screen, name), f"{name} as the title")
    await person.until("complete", "KEEP")
    took = seen - person.when_told(RunFinished)
    print(f"{name}: its verdict stood on the screen {took:.2f} s after its end")
    assert took < VERDICT_WITHIN


def _judged(screen: str, name: str) -> bool:
    over = "complete" in screen and "KEEP" in screen
    return "[5 VERDICT]" in screen and _titled(screen, name) and (over or _busy(screen))


def _titled(screen: str, name: str) -> bool:
    """Whether the verdict is that of the run; a repeat has a number."""
    return re.search(rf"^ {name}(-\d+)?: ", screen, re.MULTILINE) is not None


def _busy(screen: str) -> bool:
    words = " ".join(screen.split())  # a sentence may go on in the next line
    return any(silent in words for silent in SILENT) or f"({DISARMED})" in words


async def whole(person: Person, folder: Path) -> None:
    await person.press("enter")
    await person.until("[2 PREFLIGHT]", "does not run", "F: copy this program's applet")
    await person.press("f")
    await person.until(f"✓ good      applet       {applet_version():g} runs")
    await person.when(lambda: " BAD " not in person.screen, "nothing that is bad")

    await person.press("3", "g")  # the usual sweep of 55 s, aborted
    await person.until("Is the area clear")
    await person.press("y")
    await person.until("[4 RUN]", "HANDS OFF", "applet steers", "ABORT")
    pressed = await person.until("ARMED")
    await person.press("space")
    let_go = await person.until("aborted", "disarmed", "switch LOW", seconds=15)
    print(f"{let_go - pressed:.2f} s until the rover was let go")
    await person.until("[5 VERDICT]", "REPEAT: it did not come to its end (aborted)")

    await person.press("3")
    await shorter(person, 120)
    await person.until("sweep1           ±120  2.5 2 to 20")
    await person.press("down", "x", "up")  # without the second sweep
    await driven(person, "sweep1")
    await person.until("good", "Next: doublet1")
    await driven(person, "doublet1")
    await person.until("The plan is complete")

    await person.press("6", "l")
    await person.until("on disk: log1.BIN", "complete: 2", seconds=120)
    await person.press("7")
    await person.press("i")  # with the doublet, which no model is fitted to
    await person.until("done     identify", seconds=90)
    await person.until("90 % intervals", "report/report.html")
    await person.press("s")
    await person.until("ATC_STR_RAT_FF", "proposed", seconds=90)
    await person.press("q")
    await person.when(lambda: not person.app.is_running, "the end")


def test_a_session_by_keys_alone(rover, tmp_path, monkeypatch):
    folder = tmp_path / "session"
    arguments = ("session", "--connect", rover.connection, "--vehicle", str(ROVER_FILE))
    app = application((*arguments, "--out", str(folder), *OWN, *LIMITS), monkeypatch)

    async def session() -> None:
        async with using(app) as person:
            await whole(person, folder)
            assert not [line.text for line in app.state.messages if "internal error" in line.text]

    asyncio.run(session())
    content = read_session(folder)
    heard = [run for run in content.runs if not run.reason.startswith((*SILENT, DISARMED))]
    assert [(run.name, run.state) for run in heard] == [
        ("sweep1", "stopped"),
        ("sweep1", "done"),
        ("doublet1", "done"),
    ]
    if len(heard) == len(content.runs):
        assert [log.runs for log in content.logs] == [("sweep1-2", "doublet1")]
    assert (folder / "report" / "identification.json").is_file() and (folder / "gains.param").is_file()
