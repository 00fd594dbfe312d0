"""A whole session through the source of a screen, on the embedded rover; its folder here and elsewhere."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from types import SimpleNamespace

import pytest
from asked_source import PLAN, SETTINGS, Asked

from rover_sweep.api.read import Reading, divided, load_steered
from rover_sweep.cli.main import run as rover_sweep
from rover_sweep.cli.options import vehicle_path
from rover_sweep.data.vehicle_file import load as load_vehicle
from rover_sweep.data.vehicle_geometry import geometry_of
from rover_sweep.identification.grouping import Settings as IdentificationSettings
from rover_sweep.identification.pipeline import identify
from rover_sweep.live.source import Checked, DriveRequest, FetchLogs, Fix, Judged, Preflight, Snapshot
from rover_sweep.manoeuvre.sweep import Sweep
from rover_sweep.session.content import SessionRun
from rover_sweep.session.folder import Session, read_folder
from rover_sweep.session.session import session_runs
from rover_sweep.vehicle.events import Connected, LogSaved, Rebooting, RunFinished
from sitl import launcher
from tests.vehicle.simulated_drive import READY


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> SimpleNamespace:
    home = tmp_path_factory.mktemp("live")
    rover_file = Path(__file__).parents[1] / "data" / "rover.toml"
    with (
        launcher.start_embedded(home / "vehicle", options=READY, speedup=25) as rover,
        Asked(home / "session", rover_file) as asked,
    ):
        asked.source.session.plan(PLAN)
        asked.connect(rover.connection)
        failures = [asked.do(Preflight()), *(asked.do(DriveRequest(run, SETTINGS)) for run in PLAN)]
        asked.wait(Judged, lambda judged: judged.verdict.run == "doublet")
        failures += [asked.do(FetchLogs())]
        asked.wait(Snapshot)
        refused = asked.do(DriveRequest(SessionRun("large", Sweep(amplitude=300)), SETTINGS))
    return SimpleNamespace(folder=home / "session", asked=asked, failures=failures, refused=refused)


def test_everything_asked_was_done(session: SimpleNamespace) -> None:
    asked = session.asked
    assert session.failures == ["", "", "", ""]
    assert [event.vehicle.version for event in asked.all(Connected)] == [(4, 6, 3)]
    (checked,) = asked.all(Checked)
    assert {"firmware", "parameters", "applet"} <= {check.name for check in checked.checks}
    finished = [(run.name, run.completed) for run in asked.all(RunFinished)]
    assert finished == [("sweep1", True), ("doublet", True)]
    assert [log.path.name for log in asked.all(LogSaved)] == ["log1.BIN"]
    verdicts = [(judged.verdict.run, judged.verdict.advice) for judged in asked.all(Judged)]
    assert verdicts == [("sweep1", "keep"), ("doublet", "keep")]


def test_a_refusal_names_the_keys_that_help(session: SimpleNamespace, tmp_path: Path) -> None:
    assert "allows 250 us" in session.refused
    assert session.refused.endswith(": press 3, then E to change the run")
    vehicle = launcher.start_embedded(tmp_path / "vehicle", speedup=4)
    with vehicle as rover, Asked(tmp_path / "session") as asked:
        asked.connect(rover.connection)
        refused = asked.do(DriveRequest(PLAN[0], SETTINGS))
        assert refused == "the sweep applet does not run (SCR_ENABLE is 0): press 2, choose applet, then F"
        assert asked.do(Preflight()) == ""
        assert asked.do(Fix("applet", reboot=True)) == ""
        words = [getattr(told, "text", type(told)) for _, told in asked.told]
        assert "the rover has rebooted" in words[words.index(Rebooting) :], "it is no longer rebooting"


def test_snapshots_flow_all_the_time(session: SimpleNamespace) -> None:
    times = session.asked.when(Snapshot)
    steps = [b - a for a, b in zip(times, times[1:], strict=False)]
    assert max(steps) < 1.0
    assert sorted(steps)[len(steps) // 2] == pytest.approx(0.1, abs=0.02)
    driving = [s for s in session.asked.all(Snapshot) if s.state == 6]
    assert driving and all(s.armed and s.speed > 1 and s.recorded > 0 for s in driving)
    assert session.asked.all(Snapshot)[-1].armed is False


def test_the_folder_says_what_is_what(session: SimpleNamespace) -> None:
    content = read_folder(session.folder)
    assert content.plan == PLAN and content.to_drive == ()
    assert [(r.label, r.state, r.manoeuvre, r.left_armed) for r in content.runs] == [
        (run.name, "done", run.manoeuvre, False) for run in PLAN
    ]
    assert [(log.file, log.runs) for log in content.logs] == [("log1.BIN", ("sweep1", "doublet"))]
    assert [run.verdict["advice"] for run in content.runs if run.verdict] == ["keep", "keep"]
    assert str(session.folder.parent) not in (session.folder / "session.json").read_text()


def _identified(folder: str) -> tuple[str, list[float]]:
    """(names of the runs, every number of the bicycle) by the vehicle file in the folder."""
    vehicle = load_vehicle(vehicle_path(None, (folder,)))
    sweeps, doublets = divided(load_steered([folder], vehicle, Reading()))
    settings = IdentificationSettings(models=("bicycle",), bootstrap=0)
    found = identify(sweeps, geometry_of(vehicle), doublets, settings)
    numbers = [estimate.value for estimate in found.models["bicycle"].fit.estimates]
    return " ".join(run.name for run in (*sweeps, *doublets)), numbers


def test_carried_elsewhere_it_is_identified_the_same(session, tmp_path, monkeypatch, capsys):
    names, numbers = _identified(str(session.folder))
    assert names == "sweep1 doublet" and len(numbers) > 2
    assert rover_sweep(["coherence", str(session.folder), "--json"]) == 0
    assert [said["run"] for said in json.loads(capsys.readouterr().out)] == ["sweep1", "doublet"]
    shutil.copytree(session.folder, tmp_path / "elsewhere" / "car park")
    monkeypatch.chdir(tmp_path / "elsewhere")
    assert _identified("car park") == (names, numbers)


def test_without_logs_the_tlogs_are_read(session: SimpleNamespace, tmp_path: Path) -> None:
    from_log = session_runs(session.folder)
    assert all("log1.BIN" in dict(run.sources) for run in from_log)
    shutil.copytree(session.folder, tmp_path / "s", ignore=shutil.ignore_patterns("*.BIN"))
    from_tlog = session_runs(tmp_path / "s")
    assert [dict(run.sources).keys() for run in from_tlog] == [{"sweep1.tlog"}, {"doublet.tlog"}]
    assert [(r.name, r.kind) for r in from_tlog] == [(r.name, r.kind) for r in from_log]


def test_a_lost_description_is_made_up_for_by_the_tlogs(session: SimpleNamespace, tmp_path: Path) -> None:
    shutil.copytree(session.folder, tmp_path / "s", ignore=shutil.ignore_patterns("session.json"))
    found = Session.open(tmp_path / "s").content
    told = read_folder(session.folder)
    assert [(r.name, r.state, r.manoeuvre, r.number) for r in found.runs] == [
        (r.name, r.state, r.manoeuvre, r.number) for r in told.runs
    ]
    assert [run.name for run in session_runs(tmp_path / "s")] == ["sweep1", "doublet"]


def test_a_run_that_did_not_end_is_left_out_with_a_word(session: SimpleNamespace, tmp_path: Path) -> None:
    shutil.copytree(session.folder, tmp_path / "s")
    with (tmp_path / "s" / "doublet.tlog").open("r+b") as file:
        file.truncate((tmp_path / "s" / "doublet.tlog").stat().st_size // 2)
    told = json.loads((tmp_path / "s" / "session.json").read_text())
    told["runs"][1]["state"] = "begun"  # as a kill leaves it
    (tmp_path / "s" / "session.json").write_text(json.dumps(told))
    (run,) = session_runs(tmp_path / "s")
    assert run.name == "sweep1"
    assert any(note.text.startswith("doublet was left out: the recording ends") for note in run.notes)
    assert [planned.name for planned in Session.open(tmp_path / "s").to_drive] == ["doublet"]
