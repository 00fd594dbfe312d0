"""Starts a simulated rover, real firmware or embedded, and stops it reliably.

with start_embedded(directory) as rover: connect(rover.connection)
with start_ardurover(find_ardurover(), directory, scripts=[applet]) as rover: ...
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

from rover_sweep.system import kill_group, own_group
from sitl.guard import GRACE
from sitl.json_server import BASE_PORT, LOOPBACK
from sitl.transmitter import BASE_PORT as RADIO_PORT

ENVIRONMENT = "ROVER_SWEEP_ARDUROVER"
HOME = "51.8719,0.6245,30,0"  # latitude, longitude [deg], altitude [m], heading [deg]: north, as the plant
_TCP_BASE = 5760
_INSTANCES = 40
_POLL = 0.05

Found = TypeVar("Found")


class LaunchError(RuntimeError):
    """A simulated rover that cannot be started; the message says what to do."""


@dataclass(frozen=True)
class Running:
    """A simulated rover that runs: where to connect (pymavlink's notation) and where its files are.

    Firmware: `directory` holds logs/, scripts/, eeprom.bin and the programs' output (*.out).
    radio: UDP port of a simulated transmitter (`sitl.transmitter`), None without one.
    """

    connection: str
    directory: Path
    _programs: tuple[subprocess.Popen[bytes], ...] = field(repr=False, compare=False)
    _outputs: tuple[Path, ...] = field(repr=False, compare=False)
    radio: int | None = None

    def last_words(self) -> str:
        """Last line of output of a program that has ended on its own, '' while all run."""
        for program, output in zip(self._programs, self._outputs, strict=True):
            with contextlib.suppress(subprocess.TimeoutExpired):
                program.wait(_POLL)  # a connection breaks before its process has ended
            if program.poll() is not None:
                return _last_line(output.read_text(encoding="utf-8", errors="replace"))
        return ""

    def stop(self) -> None:
        """End what was started, children included; harmless when it has ended already."""
        for program in self._programs:
            _stop(program)

    def __enter__(self) -> Running:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()


def find_ardurover(option: str | Path | None = None) -> Path:
    """The ArduRover SITL program: `option`, else the environment's ROVER_SWEEP_ARDUROVER, else PATH.

    Raises LaunchError when there is none, or when the one named cannot be run.
    """
    asked = [("the option", option), (ENVIRONMENT, os.environ.get(ENVIRONMENT))]
    for origin, name in asked:
        if name:
            found = shutil.which(Path(name).expanduser())
            if found is None:
                raise LaunchError(
                    f"{name} (from {origin}) is not an executable program: give the path of ardurover"
                )
            return Path(found).resolve()
    found = shutil.which("ardurover")
    if found is None:
        raise LaunchError(
            "ArduRover's SITL program was not found: give its path, set "
            f"{ENVIRONMENT}, or put ardurover on PATH (sim_vehicle.py builds it as build/sitl/bin/ardurover)"
        )
    return Path(found).resolve()


def start_ardurover(
    binary: Path,
    directory: Path,
    *,
    variant: str | Path | None = "nominal",
    seed: int = 1,
    instance: int | None = None,
    speedup: float = 1.0,
    defaults: Sequence[Path] = (),
    scripts: Sequence[Path] = (),
    physics_rate: float = 1200.0,
    wheel: Path | None = None,
    timeout: float = 20.0,
) -> Running:
    """Start the real firmware in `directory` and wait until it listens; it boots when a client connects.

    variant: the plant behind it, by JSON; None takes ArduPilot's own kinematic rover. instance: ports
    5760 + 10 n (TCP) and 9002 + 10 n (physics), None takes the first free. defaults: .param files, later
    ones win. scripts: copied into scripts/. wheel: file of an IMU on the plant's front wheel. The plant's
    true motion is written to truth.csv.
    """
    directory.mkdir(parents=True, exist_ok=True)
    number = _free_instance() if instance is None else instance
    _copy(scripts, directory / "scripts")
    command = [str(binary), "--model", "rover" if variant is None else f"JSON:{LOOPBACK}"]
    command += ["--instance", str(number), "--speedup", f"{speedup:g}", "--home", HOME]
    if defaults:
        command += ["--defaults", ",".join(str(path.resolve()) for path in defaults)]
    with contextlib.ExitStack() as undo:
        programs: list[subprocess.Popen[bytes]] = []
        if variant is not None:
            physics = _start_physics(directory, variant, seed, number, physics_rate, wheel, timeout)
            undo.callback(_stop, physics)
            programs.append(physics)
        firmware = _start(command, directory / "ardurover.out", cwd=directory)
        undo.callback(_stop, firmware)
        programs.insert(0, firmware)  # stopped first, while its physics still answers
        _await(firmware, directory / "ardurover.out", _listens, timeout)
        undo.pop_all()
    outputs = tuple(directory / f"{name}.out" for name in ("ardurover", "physics"))[: len(programs)]
    connection, radio = f"tcp:{LOOPBACK}:{_TCP_BASE + 10 * number}", RADIO_PORT + 10 * number
    return Running(connection, directory, tuple(programs), outputs, radio)


def start_embedded(
    directory: Path,
    *,
    variant: str | Path = "nominal",
    seed: int = 1,
    speedup: float = 0.0,
    options: Sequence[str] = (),
    timeout: float = 20.0,
) -> Running:
    """Start the embedded rover in `directory` and wait until it listens. speedup 0: as fast as it can."""
    directory.mkdir(parents=True, exist_ok=True)
    command = [sys.executable, "-m", "sitl.embedded", "--tcp", f"{LOOPBACK}:0", "--variant", str(variant)]
    command += ["--speedup", f"{speedup:g}", "--directory", str(directory), "--seed", str(seed), *options]
    program = _start(command, directory / "embedded.out")
    try:
        ready = _await(program, directory / "embedded.out", _json_line, timeout)
    except BaseException:
        _stop(program)
        raise
    return Running(f"tcp:{LOOPBACK}:{ready['tcp']}", directory, (program,), (directory / "embedded.out",))


def _start_physics(
    directory: Path,
    variant: str | Path,
    seed: int,
    instance: int,
    rate: float,
    wheel: Path | None,
    timeout: float,
) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "sitl.json_server", "--variant", str(variant), "--seed", str(seed)]
    command += ["--instance", str(instance), "--rate", f"{rate:g}", "--truth", str(directory / "truth.csv")]
    command += [] if wheel is None else ["--wheel", str(wheel)]
    program = _start(command, directory / "physics.out")
    try:
        _await(program, directory / "physics.out", _json_line, timeout)
    except BaseException:
        _stop(program)
        raise
    return program


def _start(command: Sequence[str], output: Path, cwd: Path | None = None) -> subprocess.Popen[bytes]:
    """A guarded program (see `sitl.guard`) in its own process group, writing to a file."""
    package = str(Path(__file__).resolve().parents[1])
    paths = [package, *filter(None, [os.environ.get("PYTHONPATH")])]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}
    with output.open("wb") as sink:
        return subprocess.Popen(
            [sys.executable, "-m", "sitl.guard", *command],
            stdin=subprocess.PIPE,
            stdout=sink,
            stderr=subprocess.STDOUT,
            cwd=cwd,
            env=environment,
            **own_group(),
        )


def _stop(program: subprocess.Popen[bytes]) -> None:
    """Close the guard's standard input, then kill the rest of its process group."""
    if program.poll() is not None and (program.stdin is None or program.stdin.closed):
        return
    if program.stdin is not None:
        program.stdin.close()
    with contextlib.suppress(subprocess.TimeoutExpired):
        program.wait(GRACE + 1.0)
    kill_group(program)


def _await(
    program: subprocess.Popen[bytes], output: Path, ready: Callable[[str], Found | None], timeout: float
) -> Found:
    """What `ready` makes of the program's output, as soon as it is not None."""
    end = time.monotonic() + timeout
    while True:
        ended = program.poll()
        text = output.read_text(encoding="utf-8", errors="replace")
        if (found := ready(text)) is not None:
            return found
        last = _last_line(text)
        if ended is not None:
            raise LaunchError(f"{output.stem} ended at once with exit code {ended}: {last} (see {output})")
        if time.monotonic() > end:
            raise LaunchError(f"{output.stem} was not ready within {timeout:g} s: {last} (see {output})")
        time.sleep(_POLL)


def _last_line(text: str) -> str:
    return next(iter(text.strip().splitlines()[-1:]), "no output")


def _listens(text: str) -> bool | None:
    """ArduPilot says so; connecting to find out would use up the client that it waits for."""
    return True if "Waiting for connection" in text else None


def _json_line(text: str) -> Mapping[str, object] | None:
    for line in text.splitlines(keepends=True):
        if line.startswith("{") and line.endswith("\n"):
            parsed: Mapping[str, object] = json.loads(line)
            return parsed
    return None


def _free_instance() -> int:
    for number in range(_INSTANCES):
        tcp = [_TCP_BASE + 10 * number + serial for serial in (0, 2, 3)]
        udp = [base + 10 * number for base in (BASE_PORT, RADIO_PORT)]
        if all(_free(port, socket.SOCK_STREAM) for port in tcp) and all(
            _free(port, socket.SOCK_DGRAM) for port in udp
        ):
            return number
    raise LaunchError(f"no free instance of ArduRover among the first {_INSTANCES}: stop some of them")


def _free(port: int, kind: socket.SocketKind) -> bool:
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.setsockopt(
            socket.SOL_SOCKET, socket.SO_REUSEADDR, 1
        )  # a closed connection's port counts as free
        try:
            probe.bind((LOOPBACK, port))
        except OSError:
            return False
    return True


def _copy(scripts: Sequence[Path], folder: Path) -> None:
    folder.mkdir(exist_ok=True)
    for script in scripts:
        shutil.copy(script, folder / script.name)
