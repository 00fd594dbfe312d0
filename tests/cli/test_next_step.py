"""Every answer ends with the next step, and a command that it names exists with its options."""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from program_calls import ROVER, RunProgram

from rover_sweep.cli.main import COMMANDS, run
from rover_sweep.quality import verdict

NOMINAL = Path(__file__).parents[1] / "data/ardurover-4.6.3/nominal"
RUN = str(NOMINAL / "run1.BIN")
GROUPS = ("firmware", "params", "logs", "vehicle", "twin")


@pytest.fixture
def named(run_program: RunProgram, capsys: pytest.CaptureFixture[str]) -> Callable[..., list[str]]:
    """The commands in the last line of what a call says, each with its options looked up."""

    def steps(*call: str) -> list[str]:
        done = run_program(*call)
        last = done.err.splitlines()[-1]
        assert last.startswith("next: "), done
        commands = re.findall(r"rover-sweep [^;]+", last)
        for command in commands:
            words = [word.strip(",") for word in shlex.split(command)[1:]]
            names = words[: 2 if words[0] in GROUPS else 1]
            assert names[0] in COMMANDS and run([*names, "--help"]) == 0, command
            known = capsys.readouterr().out
            assert not [word for word in words if word.startswith("--") and word not in known], command
        return commands

    return steps


@pytest.mark.parametrize(
    ("call", "next_commands"),
    [
        (("vehicle", "--example"), ["rover-sweep vehicle check rover.toml"]),
        (
            ("vehicle", "check", ROVER),
            [f"rover-sweep design --vehicle {ROVER} --speed 2", "rover-sweep preflight --connect URL"],
        ),
        (
            ("design", "--type", "bias-sweep", "--amplitude", "80", "--bias", "100"),
            ["rover-sweep run --connect URL --vehicle rover.toml --bias-sweep 80,100"],
        ),
        (("firmware", "applet", "-o", "a.lua"), ["rover-sweep firmware check --connect URL"]),
        (("firmware", "params", "-o", "a.param"), ["rover-sweep firmware check --connect URL"]),
        (("coherence", RUN), [f"rover-sweep identify {RUN} --out report"]),
        (("view", RUN, "--out", "page.html"), [f"rover-sweep coherence {RUN}"]),
    ],
    ids=lambda value: " ".join(value[:2]) if isinstance(value, tuple) else "",
)
def test_without_a_rover(named, call, next_commands, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert named(*call) == next_commands


def test_a_weak_run_is_driven_again(run_program: RunProgram, monkeypatch: pytest.MonkeyPatch) -> None:
    judge = verdict.assess
    monkeypatch.setattr(verdict, "assess", lambda *given: replace(judge(*given), advice="repeat"))
    assert "next: drive again what is not kept" in run_program("coherence", RUN).err
