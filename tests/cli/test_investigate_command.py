"""`rover-sweep investigate`: every run has its own question, and what is kept where it ends early."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from program_calls import ROVER

from rover_sweep.api import investigation
from rover_sweep.cli.views.display import PlainDisplay
from rover_sweep.diagnosis.plans.planner import PlannedRun
from rover_sweep.diagnosis.result import Diagnosis
from rover_sweep.manoeuvre.sweep import Doublet, Manoeuvre, Sweep
from rover_sweep.session.folder import read_folder
from rover_sweep.vehicle.events import Armed, Event

DRIVEN = ("--arm", "--throttle", "1710", "--speed", "2.5", "--throw-switch", "--limit", "v_max=5")
RUN = str(Path(__file__).parents[1] / "data" / "ardurover-4.6.3" / "nominal" / "run1.BIN")


class Person:
    """Says yes so many times, then Ctrl-C; armed: how often the rover was armed."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, yes: int) -> None:
        self.left, self.armed, self.questions = yes, 0, list[str]()
        show = PlainDisplay.show

        def shown(display: PlainDisplay, event: Event) -> None:
            self.armed += isinstance(event, Armed)
            show(display, event)

        def ask(display: PlainDisplay, question: str) -> None:
            self.questions.append(question)
            self.left -= 1
            if self.left < 0:
                raise KeyboardInterrupt

        monkeypatch.setattr(PlainDisplay, "show", shown)
        monkeypatch.setattr(PlainDisplay, "ask", ask)
        monkeypatch.setattr(sys.stdin, "isatty", lambda: True, raising=False)


def short(run: PlannedRun) -> Manoeuvre:
    if run.kind == "doublet":
        return Doublet(run.amplitude_us)
    return Sweep(run.amplitude_us, w_min=2.0, w_max=20.0, t_rec=10.0)


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr("rover_sweep.cli.driving.investigating.manoeuvre_for", short)
    monkeypatch.setattr(
        investigation, "diagnosed", lambda *_: Diagnosis("refused", "made up", "roll-yaw"), raising=True
    )
    yield


def test_one_yes_drives_one_run_and_the_next_one_is_asked_for(run_program, ready, tmp_path, monkeypatch):
    person, out = Person(monkeypatch, 1), tmp_path / "today"
    command = ("investigate", "--connect", ready.connection, "--vehicle", ROVER, "--out", str(out), *DRIVEN)
    done = run_program(*command)
    assert done.code == 130, done.err
    assert person.armed == 1 and len(person.questions) == 2
    assert person.questions[0].startswith("sweep1 arms the rover and holds 2.5 m/s")
    assert [(run.name, run.state) for run in read_folder(out).runs] == [
        ("sweep1", "done"),
        ("doublet1", "stopped"),
    ]
    assert "next run: doublet of 140 us at 2.5 m/s: it is held out" in done.err
    steps = json.loads((out / "investigation.json").read_text())["steps"]
    assert [step["run"]["kind"] for step in steps] == ["sweep", "doublet"]

    again = Person(monkeypatch, 0)  # the same folder: the sweep is kept, and nothing moves without a yes
    done = run_program(*command)
    assert done.code == 130 and again.armed == 0 and len(again.questions) == 1
    assert again.questions[0].startswith("doublet2 arms the rover")
    assert "sweep1.tlog," in done.err and "doublet1.tlog (no complete run)" in done.err
    assert len(json.loads((out / "investigation.json").read_text())["steps"]) == 3


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ((), "no rover: give --connect URL"),
        (("--connect", "tcp:127.0.0.1:1", "--vehicle", ROVER), "so it needs a terminal; start it in one"),
        (("--connect", "tcp:127.0.0.1:1", RUN), "is a recorded run; leave it out to drive"),
        (("--connect", "tcp:127.0.0.1:1", "--seed", "3"), "--seed is for --simulator embedded"),
        (("--simulator", "embedded", "--arm"), "a simulated rover is always armed"),
        (("--ground", "60 by 20"), "is not a ground; write it as 60x20"),
        (("--ground", "0x20"), "is not a ground; write it as 60x20"),
        ((RUN, "--vehicle", ROVER, "--speed", "25"), "give a smaller --speed"),
    ],
)
def test_mistakes_of_an_investigation_are_one_sentence(run_program, tmp_path, monkeypatch, arguments, said):
    monkeypatch.chdir(tmp_path)
    done = run_program("investigate", *arguments)
    assert done.code == 2 and said in done.err and done.err.count("\n") == 1, done.err
    assert not list(tmp_path.iterdir())


def test_recorded_runs_get_the_next_step_and_nothing_is_driven(run_program, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = run_program("investigate", RUN, "--vehicle", ROVER, "--json")
    assert done.code == 0 and "next run: doublet" in done.err
    document = json.loads(done.out)
    assert [run["kind"] for run in document["proposal"]] == ["doublet"] and not document["settled"]
    assert not list(tmp_path.iterdir())
