"""A clock that runs too fast or too slow is named: by angles and rates, by SWEP.T, by times of arrival."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from damage import NOMINAL, rewritten

import rover_sweep as rs
from rover_sweep.cli.main import run as program
from rover_sweep.data.recording import Note, Recording
from rover_sweep.logs.log import Log
from rover_sweep.logs.read import read_logs, read_runs, runs_of
from rover_sweep.quality.faults import faults_of
from rover_sweep.quality.relations import STRETCHED, Relation, stretched_by_arrival

VEHICLE = NOMINAL.parents[1] / "rover.toml"
APPLET, TLOG = NOMINAL.parent / "applet" / "run1.BIN", NOMINAL.parent / "applet" / "run1.tlog"


def stretched(run: Recording, factor: float) -> Recording:
    """The run on a clock of which a second is `factor` true seconds."""
    channels = {c: replace(s, t=factor * s.t) for c, s in run.channels.items()}
    start, end = run.span
    return replace(run, channels=channels, span=(factor * start, factor * end), standstill=(), notes=())


@pytest.mark.parametrize("factor", [0.5, 0.9, 1.1, 1.5])
@pytest.mark.parametrize("roll", [True, False])
def test_angles_and_rates_tell(sweep: Recording, factor: float, roll: bool) -> None:
    run = sweep if roll else sweep.without({"p", "phi"})
    (fault,) = faults_of(stretched(run, factor if roll else factor**2))
    assert fault.fault == STRETCHED and {"r", "ay", "p"} <= set(fault.spoils)
    reported = float(fault.text.partition("stretched by ")[2].partition(":")[0])
    assert reported == pytest.approx(factor if roll else factor**2, rel=0.02)


@pytest.mark.parametrize("scale", [0.8, 0.87, 1.15, 1.3])
def test_gyros_of_another_scale_are_no_clock(sweep: Recording, scale: float) -> None:
    """a_y, which no clock changes, is then not V r; the diagnosis finds the scale."""
    wrong = {c: replace(sweep[c], x=scale * sweep[c].x) for c in ("r", "p")}
    run = replace(sweep, channels={**sweep.channels, **wrong}, notes=())
    assert not [fault for fault in faults_of(run) if fault.fault == STRETCHED]


@pytest.mark.parametrize("factor", [0.98, 1.02, 3.0])
def test_the_clock_of_the_applet_tells(tmp_path: Path, factor: float) -> None:
    path = rewritten(APPLET, tmp_path / "run1.BIN", {("*", "TimeUS"): lambda us: factor * us})
    (run,) = read_runs(str(path))
    (fault,) = faults_of(run)
    assert fault.fault == STRETCHED and f"stretched by {factor:.3g}: " in fault.text
    assert "SWEP.T" in fault.text
    assert [note for note in run.notes if note.fault] == [fault]


def on_a_clock(log: Log, factor: float) -> Log:
    """The log as a vehicle would have sent it whose clock runs `factor` times as fast."""
    assert log.arrivals is not None
    signals = {c: replace(s, t=factor * s.t) for c, s in log.signals.items()}
    steering = tuple(replace(s, t=factor * s.t) for s in log.steering)
    marks = tuple((factor * t, text) for t, text in log.marks)
    t, arrival = log.arrivals
    return replace(log, signals=signals, steering=steering, marks=marks, arrivals=(factor * t, arrival))


def faults_in(log: Log) -> list[Note]:
    return [note for run in runs_of(log) for note in run.notes if note.fault]


def test_the_times_of_arrival_tell_where_no_angle_was_sent() -> None:
    (log,) = read_logs(str(TLOG))
    bare = replace(log, signals={c: s for c, s in log.signals.items() if c not in ("psi", "phi")})
    assert faults_in(bare) == []
    (fault,) = faults_in(on_a_clock(bare, 1.15))
    assert fault.fault == STRETCHED and "messages of" in fault.text and "stretched by 1.15:" in fault.text
    assert [fault.fault for fault in faults_in(on_a_clock(log, 1.15))] == [STRETCHED]


@pytest.mark.parametrize("speedup", [0.5, 2.0, 10.0])
def test_a_simulation_that_outruns_time_is_not_accused(speedup: float) -> None:
    (log,) = read_logs(str(TLOG))
    assert log.arrivals is not None
    assert faults_in(replace(log, arrivals=(log.arrivals[0], log.arrivals[1] / speedup))) == []


def test_a_link_whose_delay_grows_is_not_accused() -> None:
    t = np.arange(0.0, 50.0, 0.05)
    late = np.random.default_rng(1).uniform(0.0, 0.5, t.size) + 0.02 * t
    assert list(stretched_by_arrival(t, t + late, None)) == []
    assert list(stretched_by_arrival(t, 1.1 * t, Relation(1.0, 1.0))) == []
    assert len(list(stretched_by_arrival(t, 1.1 * t, Relation(1.1, 1.0)))) == 1


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("stretched") / "run1.BIN"
    return rewritten(NOMINAL / "run1.BIN", out, {("*", "TimeUS"): lambda us: 1.2 * us})


def test_no_model_of_it_is_good(log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert program(["coherence", "--json", str(log)]) == 0
    (verdict,) = json.loads(capsys.readouterr().out)
    assert not verdict["keep"] and "the clock of this recording is stretched by 1.2:" in verdict["sentence"]
    result = rs.identify(rs.read(log, vehicle=VEHICLE), models=("bicycle",), bootstrap=0)
    assert result.recommended is None and "stretched" in " ".join(result.summary)
    assert {m.verdict.level for m in result.models.values()} <= {"poor", "not identifiable"}
    found = rs.diagnose(rs.read(log, vehicle=VEHICLE))
    assert found.verdict == "refused" and "stretched by 1.2" in found.sentence
