"""`rover-sweep run` on the embedded rover: what moves, what is shown, what is kept."""

from __future__ import annotations

import contextlib
import json

import pytest
from program_calls import DOUBLET, DRIVEN, ROVER, SWEEP

from rover_sweep.cli.driving import driven
from rover_sweep.cli.driving_options import Manoeuvres
from rover_sweep.cli.views.display import PlainDisplay
from rover_sweep.manoeuvre.sweep import Sweep
from rover_sweep.session.content import SessionRun
from rover_sweep.session.folder import Session
from rover_sweep.tui.model.plan_rows import FIRST
from rover_sweep.vehicle.events import Event, StateChanged

SECOND = ("--sweep", "amplitude=240,wmin=2,wmax=20,trec=10")
pytestmark = pytest.mark.usefixtures("few_draws")


def test_runs_are_driven_judged_fetched_and_identified(run_program, ready, tmp_path):
    out = tmp_path / "today"
    command = (
        "run",
        "--connect",
        ready.connection,
        "--vehicle",
        ROVER,
        "--out",
        str(out),
        *SWEEP,
        *DOUBLET,
        *DRIVEN,
    )
    done = run_program(*command)
    assert done.code == 0, done.err
    lines = done.err.splitlines()
    order = [
        "this program arms the rover",
        "connected to",
        "sweep1: sweep",
        "run 1 start sweep",
        "sweep1: keep",
        "doublet: done",
        "log fetched",
    ]
    places = [next(i for i, line in enumerate(lines) if words in line) for words in order]
    assert places == sorted(places)
    told_of = [line for line in lines if line.startswith("  telemetry: ")]
    assert len(told_of) == 2 and all("Hz, jitter" in line and "the rover's log" in line for line in told_of)
    (origin,) = [line for line in lines if "identified from log" in line]
    assert origin.startswith("sweep1, doublet: identified from log") and "SWEP.Out" in origin
    assert "on one clock, no messages dropped (DSF.Dp)" in origin
    assert "Use the roll-yaw model" in done.out and "(not in the fit) J_rms" in done.out
    assert done.out.rstrip().splitlines()[-2:] == [
        f"report: {out / 'report' / 'report.html'}",
        f"next: rover-sweep diagnose {out} --out {out / 'report'}; rover-sweep gains {out / 'report'}",
    ]
    written = json.loads((out / "report" / "identification.json").read_text())
    assert [run["kind"] for run in written["runs"]] == ["sweep"]
    again = run_program(*command)
    assert again.code == 2 and "already contains a session (session.json)" in again.err
    exported = run_program("export", str(out), "--model", "roll-yaw")  # of a session as well as of its report
    assert exported.code == 0 and json.loads(exported.out)["model"] == "roll-yaw"


def test_ctrl_c_lets_go_and_goes_on_with_the_whole_runs(run_program, ready, tmp_path, monkeypatch):
    """The interrupt comes while the second sweep is shown, that is, outside of the session itself."""
    seen = []
    show = PlainDisplay.show

    def interrupted(self: PlainDisplay, event: Event) -> None:
        show(self, event)
        if isinstance(event, StateChanged) and event.state == 6:
            seen.append(event)
            if len(seen) == 2:
                raise KeyboardInterrupt

    monkeypatch.setattr(PlainDisplay, "show", interrupted)
    where = ("--connect", ready.connection, "--vehicle", ROVER, "--out", str(tmp_path / "x"))
    done = run_program("run", *where, "--json", *SWEEP, *SECOND, *DOUBLET, *DRIVEN)
    assert done.code == 0, done.err
    assert "sweep2 interrupted: the rover was released" in done.err and "it is disarmed" in done.err
    assert "doublet" not in [p.stem for p in (tmp_path / "x").glob("*.tlog")]
    found = json.loads(done.out)  # nothing but the JSON; the tables are on stderr
    assert len(found["runs"]) == 1 and "Numbers of the rover" in done.err


def test_a_wrong_port_is_one_sentence_and_leaves_the_folder_usable(run_program, fresh, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    command = ("run", "--vehicle", ROVER, "--connect")
    done = run_program(*command, "tcp:127.0.0.1:1")
    assert done.code == 4 and "cannot open tcp:127.0.0.1:1" in done.err
    assert "recorded" not in done.err and done.err.count("\n") == 2
    again = run_program(*command, fresh.connection)  # taken up: nothing was driven there
    assert again.code == 4 and "rover-sweep firmware install" in again.err and "the pilot arms" in again.err
    assert [p.name for p in tmp_path.iterdir()] == ["run"]
    assert (tmp_path / "run" / "connect.tlog").stat().st_size > 0


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--throttle", "1700"), "allow arming too"),
        (("--sweep", "150,3,2"), "need 0 < w_min < w_max"),
        (("--sweep", "150,wtop=3"), "there is no 'wtop'"),
        (("--sweep", "150,x"), "'x' is not a number"),
        (("--sweep", "600"), "SWP_AMP 600 us is outside"),
        (("--doublet", "150,1,2,2.5"), "whole number"),
        (("--limit", "roll=3"), "there is no limit 'roll'"),
        (("--connect", "nonsense"), "not understood"),
        (("--out", "/dev/null/x"), "/dev/null/x cannot be written"),
        (("--vehicle", "/nowhere.toml"), "nowhere.toml"),
    ],
)
def test_mistakes_are_told_before_anything_is_connected(run_program, tmp_path, monkeypatch, arguments, said):
    monkeypatch.chdir(tmp_path)
    done = run_program("run", "--connect", "tcp:127.0.0.1:1", "--vehicle", ROVER, *arguments)
    assert done.code == 2 and said in done.err and done.err.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_amplitudes_and_frequencies_beyond_the_rover_are_refused_before_it_arms(run_program, ready, tmp_path):
    base = ("run", "--connect", ready.connection, "--vehicle", ROVER, *DRIVEN)
    done = run_program(*base, "--sweep", "300", "--out", str(tmp_path / "a"))
    assert done.code == 2 and "SWP_PWM_MAX allows 250 us" in done.err
    done = run_program(*base, "--sweep", "100,wmax=80", "--out", str(tmp_path / "b"))
    assert done.code == 2 and "samples per period at the loop rate of 100 Hz" in done.err


def test_resume_says_that_the_log_is_not_downloaded(run_program, tmp_path, monkeypatch):
    """Its sentences on the telemetry depend on it, as those of `run`."""
    with contextlib.closing(Session.open(tmp_path)) as session:
        session.plan((SessionRun("sweep1", Sweep()),))
    given: dict[str, object] = {}

    def shown(*_: object, **options: object) -> None:
        given.update(options)
        raise KeyboardInterrupt

    monkeypatch.setattr(driven, "show_session", shown)
    command = ("resume", str(tmp_path), "--connect", "tcp:127.0.0.1:1", "--vehicle", ROVER, "--no-log")
    assert run_program(*command).code == 130
    assert given["logs"] is False and given["go_on"]


def test_without_a_manoeuvre_every_command_plans_the_same_runs() -> None:
    """Sweeps at two amplitudes and a doublet, as the documentation advises."""
    run, session = Manoeuvres((), (), (), (), ()).runs, FIRST
    assert [planned.manoeuvre for planned in run] == [row.manoeuvre for row in session]
    first, second, last = (planned.manoeuvre.amplitude for planned in run)
    assert (first, second, last) == (120.0, 240.0, 150.0)
