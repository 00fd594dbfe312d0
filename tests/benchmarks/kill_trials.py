"""kill -9 at random instants: is a message that was received lost, and does the folder go on?

    python -m tests.benchmarks.kill_trials --run 100 --session 50 --driving 50

`run`: the command drives an embedded rover that is another process; `session`: the terminal session in a
terminal of its own, connected by a key, or in its first run (`driving`). A relay between the two counts what
went to the program. To count, the program is stopped (SIGSTOP) right before the kill, and what still waits in
its socket is taken off.
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
sys.path += [str(ROOT / "tests" / "live"), str(ROOT / "tests" / "tui")]
from asked_source import READY  # noqa: E402
from counted_proxy import CountedProxy  # noqa: E402
from terminal import Terminal  # noqa: E402
from test_live_kill import frames_of, unread  # noqa: E402

from rover_sweep.session.folder import read_folder  # noqa: E402
from rover_sweep.vehicle.link.mavlink import Framer  # noqa: E402
from sitl import launcher  # noqa: E402

ROVER_FILE = ROOT / "tests" / "data" / "rover.toml"
PLAN = ("--sweep", "120,2,20,10", "--doublet", "150", "--no-log")
OWN = ("--arm", "--throttle", "1710", "--throw-switch", "--limit", "v_max=5")
SPEEDUP = 8.0
LATEST = 6.0  # s after the first byte: connecting, checking, setting parameters, and the sweep
GONE_ON = 20  # each how many-th folder is driven to its end


@dataclass(frozen=True)
class Trial:
    """lost: frames received, not on disk, beyond the one read that the program had in its hands; held: those
    of that read. state: of the folder afterwards, "" where `status` fails."""

    after: float
    received: int
    held: int
    lost: int
    state: str
    resumed: str


def command(*words: str) -> list[str]:
    """The program."""
    return [sys.executable, "-m", "rover_sweep", *words]


def environment(folder: Path) -> dict[str, str]:
    return {"PYTHONPATH": str(ROOT), "XDG_STATE_HOME": str(folder / "state"), "OPENBLAS_NUM_THREADS": "1"}


@contextmanager
def by_run(url: str, folder: Path):  # type: ignore[no-untyped-def]
    """`run`, without a terminal."""
    words = ("run", "--connect", url, "--vehicle", str(ROVER_FILE), "--out", str(folder / "out"), *PLAN, *OWN)
    with subprocess.Popen(
        command(*words),
        env={**os.environ, **environment(folder)},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    ) as program:
        try:
            yield program
        finally:
            program.kill()


@contextmanager
def by_session(url: str, folder: Path):  # type: ignore[no-untyped-def]
    """The terminal session, which connects and looks at the rover."""
    words = ("session", "--connect", url, "--vehicle", str(ROVER_FILE), "--out", str(folder / "out"), *OWN)
    with Terminal(command(*words), environment(folder)) as terminal:
        terminal.until("[1 CONNECT]")
        terminal.press("\r")
        yield terminal.program


@contextmanager
def by_driving_session(url: str, folder: Path):  # type: ignore[no-untyped-def]
    """The terminal session in its first run."""
    words = ("session", "--connect", url, "--vehicle", str(ROVER_FILE), "--out", str(folder / "out"), *OWN)
    with Terminal(command(*words), environment(folder)) as terminal:
        terminal.until("[1 CONNECT]")
        terminal.press("\r")
        terminal.until("[2 PREFLIGHT]", "are good")
        terminal.press("3")
        terminal.until("[3 PLAN]", "sweep1")
        terminal.press("g")
        terminal.until("Is the area clear")
        terminal.press("y")
        yield terminal.program


def trial(number: int, start: Callable, chance: random.Random) -> Trial:  # type: ignore[type-arg]
    """One program killed at a random instant after the first byte; a kill may leave the rover armed, so each
    has its own."""
    with tempfile.TemporaryDirectory() as place:
        folder, after = Path(place), chance.uniform(0.0, LATEST)
        with (
            rover(folder / "vehicle") as running,
            CountedProxy(running.connection) as proxy,
            start(proxy.url, folder) as program,
        ):
            _await(lambda: bool(proxy.to_station))
            time.sleep(after)
            os.kill(program.pid, signal.SIGSTOP)
            time.sleep(0.05)
            received = _received(proxy)
            os.kill(program.pid, signal.SIGKILL)
            program.wait()
        sent = [frame for frame, whole in Framer().feed(received) if whole]
        missing = len(sent) - _kept(folder / "out", sent)
        return Trial(
            after,
            len(sent),
            min(max(missing, 0), _LAST_READ),
            max(missing - _LAST_READ, 0),
            _state(folder / "out"),
            _resumed(number, folder),
        )


def rover(folder: Path) -> launcher.Running:
    """An embedded one that has what identification needs."""
    return launcher.start_embedded(folder, options=READY, speedup=SPEEDUP)


_LAST_READ = 10  # frames that one read of the socket brings, at the most that was seen


def _await(condition: Callable[[], bool], seconds: float = 60.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, f"nothing came within {seconds:.0f} s"
        time.sleep(0.02)


def _received(proxy: CountedProxy) -> bytes:
    """What the stopped program has taken out of its socket."""
    count, waiting = -1, 0
    while count != len(proxy.to_station):  # until nothing came in between the two
        count = len(proxy.to_station)
        with suppress(OSError):  # it ended by itself before
            waiting = unread(proxy)
    return proxy.to_station[: count - waiting]


def _kept(out: Path, sent: Sequence[bytes]) -> int:
    """How many of the frames sent are on disk, in their order, in whichever .tlog."""
    parts = sorted(out.glob("*.tlog"), key=_first_stamp)
    frames = [frame for path in parts for frame in frames_of(path)]
    at = next((k for k, (ours, theirs) in enumerate(zip(frames, sent, strict=False)) if ours != theirs), None)
    return at if at is not None else min(len(frames), len(sent))


def _first_stamp(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(8)


def _state(out: Path) -> str:
    """What `status` and the folder say; "" where that fails."""
    if not out.is_dir():
        return "no folder yet"
    with suppress(Exception):
        finished = subprocess.run(
            command("status", str(out)),
            env={**os.environ, "PYTHONPATH": str(ROOT)},
            capture_output=True,
            text=True,
            timeout=60,
        )
        states = ",".join(run.state for run in read_folder(out).runs)
        if finished.returncode == 0:
            return states or "nothing driven"
        return "" if "Traceback" in finished.stderr else f"refused: {finished.stderr.strip()[:80]}"
    return ""


def _resumed(number: int, folder: Path) -> str:
    """Driven to its end, for each `GONE_ON`-th; the rover was switched off and on meanwhile."""
    out = folder / "out"
    if number % GONE_ON or not (out / "session.json").is_file() or not read_folder(out).to_drive:
        return ""
    with rover(folder / "again") as running:
        words = ("resume", str(out), "--connect", running.connection, *OWN[:4])
        done = subprocess.run(
            command(*words),
            env={**os.environ, **environment(folder)},
            capture_output=True,
            text=True,
            timeout=180,
        )
    left = len(read_folder(out).to_drive)
    return "whole" if left == 0 else f"exit {done.returncode}, {left} left: {done.stderr.strip()[-200:]}"


def trials(name: str, count: int, start: Callable, seed: int) -> list[Trial]:  # type: ignore[type-arg]
    """So many, each reported when it ends."""
    chance, found = random.Random(f"{seed}/{name}"), list[Trial]()
    for number in range(count):
        t = trial(number, start, chance)
        found.append(t)
        print(
            f"{name} {number:3d} after {t.after:4.1f} s: {t.received:6d} received, {t.held} in its hands, "
            f"{t.lost} lost; {t.state} {t.resumed}",
            flush=True,
        )
    return found


def summary(name: str, found: Sequence[Trial]) -> str:
    """One line."""
    held = max((t.held for t in found), default=0)
    bad = [t for t in found if not t.state]
    resumed = [t.resumed for t in found if t.resumed]
    return (
        f"{name}: {len(found)} kills, {sum(t.received for t in found)} messages received, "
        f"{sum(t.lost for t in found)} lost, at most {held} of the read under way not written yet; "
        f"{len(bad)} folders unreadable; {resumed.count('whole')} of {len(resumed)} driven to their end"
    )


def main() -> int:
    """Exit code 1 where a message was lost or a folder does not go on."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--run", type=int, default=10)
    parser.add_argument("--session", type=int, default=10)
    parser.add_argument("--driving", type=int, default=10)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    done = {
        name: trials(name, count, start, asked.seed)
        for name, count, start in (
            ("run", asked.run, by_run),
            ("session", asked.session, by_session),
            ("driving", asked.driving, by_driving_session),
        )
    }
    for name, found in done.items():
        print(summary(name, found))
    everything = [t for found in done.values() for t in found]
    return int(any(t.lost or not t.state or t.resumed not in ("", "whole") for t in everything))


if __name__ == "__main__":
    sys.exit(main())
