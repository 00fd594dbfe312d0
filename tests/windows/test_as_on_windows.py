"""The program in a Python without what Windows lacks, in a folder with spaces and umlauts, on a console of
code page 1252. It is no real Windows: see `as_on_windows/sitecustomize.py`."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
LOGS = ROOT / "tests" / "data" / "ardurover-4.6.3" / "nominal"
ROVER = ROOT / "tests" / "data" / "rover.toml"

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="imitates Windows on Linux")


@pytest.fixture
def place(tmp_path: Path) -> Path:
    """As people name their folders."""
    folder = tmp_path / "Jörg Müßig" / "Rover Läufe (2026)"
    folder.mkdir(parents=True)
    return folder


def as_on_windows(place: Path, *command: str, code: int = 0) -> subprocess.CompletedProcess[str]:
    """Python there with these arguments."""
    paths = os.pathsep.join([str(Path(__file__).parent / "as_on_windows"), str(ROOT)])
    special = {
        "PYTHONPATH": paths,
        "PYTHONIOENCODING": "cp1252",
        "PYTHONWARNDEFAULTENCODING": "1",
        "TEXTUAL_DRIVER": "textual.drivers.headless_driver:HeadlessDriver",  # that of Linux needs termios
    }
    done = subprocess.run(
        [sys.executable, *command],
        cwd=place,
        env={**os.environ, **special, "XDG_STATE_HOME": str(place / "state")},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        encoding="cp1252",
        timeout=600,
    )
    assert done.returncode == code, done.stdout[-2000:] + done.stderr[-6000:]
    assert "Traceback" not in done.stderr
    return done


def rover_sweep(place: Path, *arguments: str, code: int = 0) -> subprocess.CompletedProcess[str]:
    return as_on_windows(place, "-m", "rover_sweep", *arguments, code=code)


def test_calls_that_a_system_lacks_are_in_one_module() -> None:
    lacking = re.compile(
        r"import (termios|tty|fcntl|pty|resource\b|msvcrt|winreg)|SIG(KILL|HUP|BREAK)|CLOCK_BOOTTIME"
        r"|preexec_fn|start_new_session|creationflags|os\.(fork|setsid|killpg|getpg|getppid|nice|setpri|sched_)"
    )
    files = [path for folder in ("rover_sweep", "sitl") for path in (ROOT / folder).rglob("*.py")]
    found = [path.name for path in files if lacking.search(path.read_text(encoding="utf-8"))]
    assert found == ["system.py"]


def test_help_and_a_missing_port(place: Path) -> None:
    assert "dry-run" in rover_sweep(place, "--help").stdout
    said = rover_sweep(place, "preflight", "--connect", "COM7:57600", code=4).stderr
    assert "there is no serial port COM7; plugged in: COM5: CubeOrange" in said


def test_dry_run(place: Path) -> None:
    short = ("--sweep", "160,2,20,10", "--doublet", "150", "--out", "kurzer Test")
    done = rover_sweep(place, "dry-run", *short)
    assert re.search(r"(?m)^.*roll-yaw", done.stdout)
    assert (place / "kurzer Test" / "report" / "report.html").is_file()


def test_batch_in_two_processes(place: Path) -> None:
    logs = place / "Käfer 1"
    logs.mkdir()
    shutil.copy(LOGS / "run1.BIN", logs / "2026-03-01.BIN")
    (logs / "2026-03-20.BIN").write_bytes(b"no log")
    shutil.copy(ROVER, logs / "rover.toml")
    done = rover_sweep(place, "batch", str(logs), "--out", "Saison", "--workers", "2")
    assert "2 of 2 logs done" in done.stderr and "is not a DataFlash log" in done.stdout
    assert (place / "Saison" / "season.html").is_file()


SESSION = """
import asyncio, sys
from pathlib import Path

import rover_sweep.tui.app as app_module
from rover_sweep.errors import UsageError
from rover_sweep.session.folder import FolderLock
from rover_sweep.tui.jobs import AnalysisJob, run_job
from sitl import launcher


async def looked_at(app):
    async with app.run_test(size=(100, 30)) as pilot:
        await pilot.pause()
        print([place.origin for place in app.places if place.url == "COM5"])
        try:
            FolderLock(Path("Sitzung"))
        except UsageError as error:
            print(error)
        await pilot.press("enter")
        for _ in range(600):
            if app.state.checks:
                break
            await pilot.pause(0.1)
        print("checked", len(app.state.checks) > 10, app.state.vehicle.words)
        async for job in run_job(AnalysisJob("vehicle", ("vehicle", "--example"))):
            pass
        print(job.outcome, job.output.startswith("# rover.toml"))
        await pilot.press("q")


def show(source, setup, in_browser=False):
    try:
        asyncio.run(looked_at(app_module.SweepApp(source, setup)))
    finally:
        source.close()


app_module.show = show
if __name__ == "__main__":
    from rover_sweep.cli.main import run

    ready = ("--applet", "--parameter", "SCR_ENABLE=1")
    with launcher.start_embedded(Path("Fahrzeug ä"), options=ready) as rover:
        code = run(["session", "--connect", rover.connection, "--vehicle", sys.argv[1], "--out", "Sitzung"])
    sys.exit(code)
"""


def test_the_terminal_session(place: Path) -> None:
    (place / "program.py").write_text(SESSION, encoding="utf-8")
    said = as_on_windows(place, "program.py", str(ROVER)).stdout
    assert "['plugged in: CubeOrange']" in said
    assert "another rover-sweep uses Sitzung" in said
    assert "checked True ArduRover 4.6.3" in said and "done True" in said


WORKERS = """
import multiprocessing, os, signal, time
from concurrent.futures import ProcessPoolExecutor
from rover_sweep.system import end_with_parent

if __name__ == "__main__":
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, context, end_with_parent) as pool:
        print(pool.submit(os.getpid).result(), flush=True)
        os.kill(os.getpid(), 9)
"""


def runs(process: int) -> bool:
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_a_worker_ends_when_the_program_is_killed(place: Path) -> None:
    (place / "program.py").write_text(WORKERS, encoding="utf-8")
    worker = int(as_on_windows(place, "program.py", code=-9).stdout)  # returns when the worker's pipes close
    until = time.monotonic() + 10
    while runs(worker):
        assert time.monotonic() < until
        time.sleep(0.05)
