"""`rover-sweep dry-run`: streams, order, folders, refusals, and the numbers that only a simulation knows."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from program_calls import DOUBLET, SWEEP

from rover_sweep.cli.driving.simulated import truth
from rover_sweep.logs.read import read_runs
from rover_sweep.session.folder import read_folder
from sitl.plant.effects.replaced_numbers import resolved
from sitl.plant.variant import load_variant


@pytest.fixture
def private() -> Iterator[None]:
    """A umask under which only the owner may read."""
    before = os.umask(0o077)
    yield
    os.umask(before)


def test_results_to_stdout_narration_in_order_and_the_truth(
    run_program, tmp_path, monkeypatch, few_draws, private
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "dry-run").mkdir()
    (tmp_path / "dry-run" / "notes.txt").write_text("mine")
    sweep = ("--sweep", "320,2,20,10")  # past SWP_PWM_MAX as it comes
    done = run_program("dry-run", *sweep, *DOUBLET)
    assert done.code == 0, done.err
    report, following = done.out.rstrip().splitlines()[-2:]
    assert report == "report: dry-run-2/report/report.html"
    assert following.startswith("next: rover-sweep diagnose dry-run-2 --out dry-run-2/report")
    lines = done.err.splitlines()
    order = ["connected to", "sweep1: sweep, +-320", "sweep1: keep", "doublet: done"]
    places = [next(i for i, line in enumerate(lines) if words in line) for words in order]
    assert places == sorted(places) and "━" not in done.err + done.out
    truth = done.out.partition("True parameters of the simulated rover")[2].splitlines()
    inertia = next(line.split() for line in truth if line.startswith("I_zz"))
    true, found, percent = (float(x) for x in inertia[-3:])
    assert true == 0.071 and percent == pytest.approx(100 * (found / true - 1), abs=0.1)
    written = json.loads((tmp_path / "dry-run-2/report/identification.json").read_text())
    assert found == pytest.approx(written["numbers"]["Izz"]["value"], rel=1e-3)
    assert [p.name for p in (tmp_path / "dry-run").iterdir()] == ["notes.txt"]
    (log,) = (tmp_path / "dry-run-2").glob("*.BIN")
    recorded = read_runs(str(log))
    assert [run.kind for run in recorded] == ["sweep", "doublet"]
    amplitudes = [abs(run.manoeuvre("pwm").x - 1500).max() for run in recorded]
    assert amplitudes == pytest.approx([320, 150], abs=2)
    made = list((tmp_path / "dry-run-2").rglob("*"))  # pages, pictures, logs, the session
    assert len(made) > 20 and not [path for path in made if path.stat().st_mode & 0o077]
    again = run_program("dry-run", "--out", "dry-run-2")
    assert again.code == 2 and "already contains a session" in again.err and again.err.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--seed", "-1"), "--seed"),
        (("--sweep", "402"), "402 us exceeds the 400 us"),
        (("--sweep", "120,wmax=70"), "9.0 samples per period at the loop rate of 100 Hz"),
        (("--sweep", "120,trec=700"), "SWP_TREC 700 s is outside 1 to 600"),
        (("--sweep", "120,wmin=30"), "w_min"),
        (("--variant", "none"), "no variant none"),
        (("--out", "/dev/null/x"), "/dev/null/x cannot be written: Not a directory"),
        (("--out", "file/x"), "cannot be written: Not a directory"),
        (("--throw-switch", "pilot"), "has no radio for switch 6"),
    ],
)
def test_mistakes_are_told_at_once_and_leave_nothing(run_program, tmp_path, monkeypatch, arguments, said):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_text("")
    done = run_program("dry-run", *arguments)
    assert done.code == 2 and said in done.err and done.err.count("\n") == 1
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize(
    ("how", "times"),
    [
        (signal.SIGTERM, 3),  # the second and the third come while the rover is let go
        (signal.SIGQUIT, 1),
        *(
            pytest.param(how, 1, marks=pytest.mark.slow)
            for how in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
        ),
    ],
)
def test_being_ended_says_what_was_kept_and_that_the_rover_was_let_go(tmp_path, how, times):
    """As in the background of a script, where Ctrl-C is ignored from the start."""
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    hangup = signal.signal(signal.SIGHUP, signal.SIG_DFL)  # under nohup it ends nothing
    command = [sys.executable, "-m", "rover_sweep", "dry-run", *SWEEP, *SWEEP, "--out", str(tmp_path / "x")]
    program = subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True)
    signal.signal(signal.SIGINT, before)
    signal.signal(signal.SIGHUP, hangup)
    assert program.stderr is not None
    with program.stderr as err:
        lines = []
        for line in err:
            lines.append(line)
            if "sweep2: sweep" in line:
                time.sleep(0.5)
                for _ in range(times):
                    program.send_signal(how)
                    time.sleep(0.005)
    assert program.wait(20) == 130
    text = "".join(lines)
    assert "sweep2 interrupted: the rover was released" in text
    assert f"kept in {tmp_path / 'x'}: sweep1.tlog, sweep2.tlog (no complete run)" in text
    assert [run.left_armed for run in read_folder(tmp_path / "x").runs] == [False, False]


def test_a_simulated_rover_that_dies_says_why(run_program, tmp_path, monkeypatch):
    """It dies when the first ground station connects, after it said that it was ready."""
    broken = tmp_path / "broken.py"
    broken.write_text(
        "import json, socket, sys\n"
        "s = socket.create_server(('127.0.0.1', 0))\n"
        "print(json.dumps({'tcp': s.getsockname()[1]}), flush=True)\n"
        "s.accept()\n"
        "sys.exit('the tyres fell off')\n"
    )
    from sitl import launcher

    start = launcher._start
    monkeypatch.setattr(launcher, "_start", lambda _, *rest: start([sys.executable, str(broken)], *rest))
    done = run_program("dry-run", "--out", str(tmp_path / "x"))
    assert done.code == 4 and "the simulated rover ended: the tyres fell off" in done.err


def test_effects_of_a_variant_show_in_the_truth(tmp_path: Path) -> None:
    path = tmp_path / "slow.toml"
    path.write_text(
        'base = "nominal"\n[effects]\nservo_lag = { T = 0.09 }\nfront_rear_stiffness = { ratio = 1.5 }\n'
    )
    true, nominal = truth(resolved(load_variant(path))), truth(load_variant("nominal"))
    assert true["tau"] == pytest.approx(0.09 + 0.015)
    assert true["Cf"] / true["Cr"] == pytest.approx(1.5) and true["C"] == pytest.approx(nominal["C"])
    assert true["Izz"] == nominal["Izz"]
