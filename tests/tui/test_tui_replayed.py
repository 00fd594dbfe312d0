"""The application that `replay` shows of a real recording, and that of `session` in a real terminal."""

from __future__ import annotations

import asyncio
import os
import select
import subprocess
import sys
from pathlib import Path

import pytest
from by_keys import Person, application, using

from rover_sweep.live.source import Played

RECORDING = Path(__file__).parents[1] / "data" / "ardurover-4.6.3" / "nominal" / "run1.BIN"


def at(person: Person) -> Played:
    played = person.app.state.played
    assert played is not None
    return played


async def played(person: Person) -> None:
    await person.until("[4 RUN]", "REPLAY: A recording: nothing moves", "x1")
    await person.press("space")
    await person.until("PAUSED", "SPACE  pause")
    stood = at(person)
    await asyncio.sleep(0.5)
    assert at(person) == stood

    await person.press(".", ".", ".")
    await person.when(lambda: at(person).t > stood.t + 20, "three jumps")
    await person.press(",")
    await person.when(lambda: at(person).t == pytest.approx(stood.t + 20, abs=0.5), "one back")
    await person.until("applet steers", "ARMED", "sweep ±")  # 20 s after the start it sweeps

    await person.press("space")
    await person.until("x1")
    for pace in (2, 4, 8, 16):
        await person.press("+")
        await person.until(f"x{pace}")
    await person.press("-")
    await person.until("x8")
    await person.press("+", "+", "+")
    await person.until("x64")
    await person.until("[5 VERDICT]", "✓ complete", "KEEP", "yaw rate", "roll rate")

    await person.press("1", "enter", "3", "g", "6", "l")  # nothing of it can be asked of a recording
    assert not person.app.state.busy and not person.app.state.failure and person.app.is_running
    await person.press("7")
    await person.until("Identify this recording with: rover-sweep identify", "run1.BIN")
    await person.press("q")
    await person.when(lambda: not person.app.is_running, "the end")


def test_a_recording_is_played_by_keys(monkeypatch: pytest.MonkeyPatch) -> None:
    app = application(("replay", str(RECORDING)), monkeypatch)

    async def session() -> None:
        async with using(app) as person:
            await played(person)

    asyncio.run(session())


@pytest.mark.skipif(sys.platform == "win32", reason="needs a pseudo-terminal")
def test_a_session_in_a_terminal_ends_by_a_key(tmp_path: Path) -> None:
    master, slave = os.openpty()
    command = [sys.executable, "-m", "rover_sweep", "session", "--out", str(tmp_path / "session")]
    environment = {**os.environ, "TERM": "xterm-256color", "XDG_STATE_HOME": str(tmp_path)}
    with open(master, "r+b", buffering=0) as person, open(slave, "wb") as terminal:
        program = subprocess.Popen(command, stdin=slave, stdout=slave, stderr=terminal, env=environment)
        said = b""
        while b"CONNECT" not in said:
            said += person.read(65536)
        person.write(b"q")
        while program.poll() is None:
            if select.select([person], [], [], 0.1)[0]:
                person.read(65536)
    assert program.returncode == 0
