"""`rover-sweep preflight` on the embedded rover: seen, put right one by one, and its mistakes."""

from __future__ import annotations

import json

import pytest

from rover_sweep.vehicle.preflight.readiness import NAMES
from sitl import launcher


def test_from_the_factory_to_a_rover_that_may_be_driven(run_program, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    stick = ("--parameter", "RC1_TRIM=1600")  # which only a person can put right
    with launcher.start_embedded(tmp_path / "rover", options=stick, speedup=8) as rover:
        where = ("preflight", "--connect", rover.connection)
        before = (rover.directory / "parameters.txt").read_text()
        done = run_program(*where, "--w-max", "80")
        assert done.code == 1
        assert done.err.startswith(f"next: rover-sweep preflight --connect {rover.connection} --fix ")
        assert "SCHED_LOOP_RATE is 50, wanted at least 100" in done.out
        assert "samples a period at 50 Hz" in " ".join(done.out.split())
        assert "--fix parameters: set SCR_ENABLE" in done.out
        assert done.out.splitlines()[-1].endswith("checks must be fixed")
        assert (rover.directory / "parameters.txt").read_text() == before
        done = run_program(*where, "--fix", "parameters", "--fix", "applet", "--yes", "--json")
        assert "rebooting the rover to apply SCR_ENABLE, SCHED_LOOP_RATE" in done.err
        found = {check["name"]: check["state"] for check in json.loads(done.out)["checks"]}
        assert tuple(found) == NAMES
        settled = ("parameters", "applet", "loop_rate", "filters", "logging", "source", "switch")
        assert {name: found[name] for name in settled} == dict.fromkeys(settled, "good")
        done = run_program(*where, "--fix", "rc", "--yes")
        assert done.code == 2 and "rc can only be corrected by hand: leave the sticks alone" in done.err


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (("--fix", "weather"), 2, "there is no check 'weather'; there are armed, firmware"),
        (("--fix", "parameters"), 2, "stdin is not a terminal; give --yes"),
        ((), 4, "cannot open tcp:127.0.0.1:1"),
    ],
)
def test_mistakes_are_one_sentence(run_program, arguments, code, said):
    done = run_program("preflight", "--connect", "tcp:127.0.0.1:1", *arguments)
    assert (done.code, done.out) == (code, "") and said in done.err and done.err.count("\n") == 1
