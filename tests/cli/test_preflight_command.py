"""`rover-sweep preflight` on the embedded rover: seen, put right one by one, and its mistakes."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from program_calls import RunProgram

from rover_sweep.vehicle.preflight.readiness import NAMES
from sitl import launcher


def states(out: str) -> dict[str, str]:
    return {check["name"]: check["state"] for check in json.loads(out)["checks"]}


def test_from_the_factory_to_a_rover_that_may_be_driven(
    run_program: RunProgram, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with launcher.start_embedded(tmp_path / "rover", speedup=8) as rover:
        where = ("preflight", "--connect", rover.connection)
        before = (rover.directory / "parameters.txt").read_text()
        done = run_program(*where)
        assert done.code == 1 and done.err.startswith("next: ")
        assert "SCHED_LOOP_RATE is 50, wanted at least 100" in done.out
        assert "--fix parameters: set SCR_ENABLE" in done.out
        assert done.out.splitlines()[-1].endswith("checks must be fixed")
        assert (rover.directory / "parameters.txt").read_text() == before
        done = run_program(*where, "--fix", "parameters", "--fix", "applet", "--yes", "--json")
        assert "rebooting the rover to apply SCR_ENABLE, SCHED_LOOP_RATE" in done.err
        found = states(done.out)
        assert tuple(found) == NAMES
        settled = ("parameters", "applet", "loop_rate", "filters", "logging", "source", "switch", "rc")
        assert {name: found[name] for name in settled} == dict.fromkeys(settled, "good")
        assert "the .BIN log" in run_program(*where).out
        nothing = run_program(*where, "--fix", "filters", "--yes")
        assert "filters: nothing to fix" in nothing.err


def test_a_sweep_that_is_too_fast_for_the_loop_is_seen(
    run_program: RunProgram, ready: launcher.Running
) -> None:
    done = run_program("preflight", "--connect", ready.connection, "--w-max", "80", "--json")
    checks = {check["name"]: check for check in json.loads(done.out)["checks"]}
    assert done.code == 1 and checks["loop_rate"]["state"] == "bad"
    assert checks["loop_rate"]["remedy"]["sets"] == [["SCHED_LOOP_RATE", 200.0]]
    assert "INS_GYRO_FILTER 20 Hz" in checks["filters"]["sentence"]


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (("--fix", "weather"), 2, "there is no check 'weather'; there are armed, firmware"),
        (("--fix", "parameters"), 2, "stdin is not a terminal; give --yes"),
        ((), 4, "cannot open tcp:127.0.0.1:1"),
    ],
)
def test_mistakes_are_one_sentence(
    run_program: RunProgram, arguments: tuple[str, ...], code: int, said: str
) -> None:
    done = run_program("preflight", "--connect", "tcp:127.0.0.1:1", *arguments)
    assert (done.code, done.out) == (code, "") and said in done.err and done.err.count("\n") == 1


def test_what_only_a_person_can_do_is_refused(run_program: RunProgram, ready: launcher.Running) -> None:
    trim = ready.directory / "trim.param"
    trim.write_text("RC1_TRIM 1600\n")
    assert run_program("params", "push", str(trim), "--yes", "--connect", ready.connection).code == 0
    done = run_program("preflight", "--fix", "rc", "--yes", "--connect", ready.connection)
    assert done.code == 2 and "rc can only be corrected by hand: leave the sticks alone" in done.err
