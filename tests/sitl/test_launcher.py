"""Launcher: finds, starts, waits, and leaves nothing behind. A small script stands in for the programs."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from sitl import launcher
from sitl.launcher import LaunchError, Running, find_ardurover, start_ardurover, start_embedded

pytestmark = pytest.mark.skipif(os.name != "posix", reason="the stand-in is a shell script")
REPOSITORY = Path(launcher.__file__).parents[1]


def program(path: Path, body: str) -> Path:
    path.write_text(f"#!/bin/sh\n{body}\n")
    path.chmod(0o755)
    return path


def firmware(tmp_path: Path) -> Path:
    """Records its process and arguments, has a child of its own, and says that it listens."""
    body = """echo "$$" > pid; echo "$@" > arguments
        sleep 600 & echo $! > child
        echo "Waiting for connection ...."; wait"""
    return program(tmp_path / "fake_rover", body)


def all_run(rover: Running) -> bool:
    return all(program.poll() is None for program in rover._programs)


def runs(pid_file: Path) -> bool:
    pid = int(pid_file.read_text())
    stat = Path(f"/proc/{pid}/stat")
    if stat.parent.parent.joinpath("self").exists():
        try:
            return stat.read_text().rpartition(")")[2].split()[0] != "Z"
        except (FileNotFoundError, ProcessLookupError):  # it may go while we look
            return False
    return subprocess.run(["kill", "-0", str(pid)], capture_output=True).returncode == 0


def gone(*pid_files: Path) -> bool:
    end = time.monotonic() + 8.0
    while any(runs(path) for path in pid_files) and time.monotonic() < end:
        time.sleep(0.05)
    return not any(runs(path) for path in pid_files)


def test_option_before_environment_before_path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("one", "two", "three"):
        (tmp_path / name).mkdir()
        program(tmp_path / name / "ardurover", "exit 0")
    monkeypatch.setenv("PATH", str(tmp_path / "three"))
    monkeypatch.delenv(launcher.ENVIRONMENT, raising=False)
    assert find_ardurover() == (tmp_path / "three" / "ardurover").resolve()
    monkeypatch.setenv(launcher.ENVIRONMENT, str(tmp_path / "two" / "ardurover"))
    assert find_ardurover().parent.name == "two"
    assert find_ardurover(tmp_path / "one" / "ardurover").parent.name == "one"


def test_absent_binary_says_what_to_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv(launcher.ENVIRONMENT, raising=False)
    with pytest.raises(LaunchError, match="set ROVER_SWEEP_ARDUROVER, or put ardurover on PATH"):
        find_ardurover()
    with pytest.raises(LaunchError, match=r"nowhere \(from the option\) is not an executable program"):
        find_ardurover(tmp_path / "nowhere")
    monkeypatch.setenv(launcher.ENVIRONMENT, str(tmp_path))
    with pytest.raises(LaunchError, match=r"\(from ROVER_SWEEP_ARDUROVER\) is not an executable program"):
        find_ardurover()


def test_starts_firmware_with_json_physics_and_stops_both(tmp_path: Path) -> None:
    applet = tmp_path / "applet.lua"
    applet.write_text("return 1")
    parameters = tmp_path / "some.param"
    parameters.write_text("A 1")
    work = tmp_path / "work"
    with start_ardurover(
        firmware(tmp_path), work, speedup=5, defaults=[parameters], scripts=[applet]
    ) as rover:
        assert all_run(rover) and rover.directory == work
        arguments = (work / "arguments").read_text()
        number = int(arguments.split("--instance ")[1].split()[0])
        assert rover.connection == f"tcp:127.0.0.1:{5760 + 10 * number}"
        assert "--model JSON:127.0.0.1 " in arguments and "--speedup 5 " in arguments
        assert f"--defaults {parameters}" in arguments
        assert (work / "scripts" / "applet.lua").read_text() == "return 1"
        assert f'{{"udp": {9002 + 10 * number}, "variant": "nominal"}}' in (work / "physics.out").read_text()
        assert runs(work / "pid") and runs(work / "child")
    assert not all_run(rover)
    assert gone(work / "pid", work / "child")
    rover.stop()


def test_a_program_that_ends_or_hangs_at_once_is_told_with_its_last_words(tmp_path: Path) -> None:
    broken = program(tmp_path / "broken", "echo starting; echo no such model; exit 3")
    with pytest.raises(
        LaunchError, match=r"ardurover ended at once with exit code 3: no such model \(see .*\.out\)"
    ):
        start_ardurover(broken, tmp_path / "work", variant=None)
    silent = program(tmp_path / "silent", "echo $$ > pid; echo $@ > arguments; exec sleep 600")
    with pytest.raises(LaunchError, match="was not ready within 1 s: no output"):
        start_ardurover(silent, tmp_path / "work2", variant=None, instance=31, timeout=1.0)
    assert gone(tmp_path / "work2" / "pid") and not (tmp_path / "work2" / "physics.out").exists()
    assert "--model rover --instance 31" in (tmp_path / "work2" / "arguments").read_text()


def test_nothing_survives_when_we_are_killed(tmp_path: Path) -> None:
    work = tmp_path / "work"
    code = (
        "import sys, time; from pathlib import Path; from sitl.launcher import start_ardurover\n"
        f"rover = start_ardurover(Path({str(firmware(tmp_path))!r}), Path({str(work)!r}), variant=None)\n"
        "print('up', flush=True); time.sleep(600)"
    )
    ours = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, cwd=REPOSITORY)
    assert ours.stdout is not None and ours.stdout.readline() == b"up\n"
    assert runs(work / "pid")
    os.kill(ours.pid, signal.SIGKILL)
    ours.wait()
    ours.stdout.close()
    assert gone(work / "pid", work / "child")


def test_a_program_deaf_to_the_polite_signal_is_killed(tmp_path: Path) -> None:
    deaf = program(
        tmp_path / "deaf",
        "trap '' TERM; echo $$ > pid; echo Waiting for connection; while :; do sleep 1; done",
    )
    rover = start_ardurover(deaf, tmp_path / "work", variant=None)
    rover.stop()
    assert gone(tmp_path / "work" / "pid")


def test_embedded_rover_starts_and_stops(tmp_path: Path) -> None:
    pytest.importorskip("sitl.embedded")
    with start_embedded(tmp_path / "work", seed=2) as rover:
        assert isinstance(rover, Running) and all_run(rover)
        assert rover.connection.startswith("tcp:127.0.0.1:")
        assert int(rover.connection.rpartition(":")[2]) > 1023
    assert not all_run(rover)
