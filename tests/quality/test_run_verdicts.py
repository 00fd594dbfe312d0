"""Verdicts on runs: too short, the same in every command, at the stops, with another clock."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from damage import NOMINAL, damaged, rewritten

import rover_sweep as rs
from rover_sweep.api.diagnosis_input import Material, diagnosed
from rover_sweep.cli.main import run as command
from rover_sweep.data.recording import Note, Recording
from rover_sweep.data.vehicle_geometry import geometry_of
from rover_sweep.diagnosis.result import DiagnosisSettings
from rover_sweep.identification.grouping import Settings
from rover_sweep.identification.pipeline import identify
from rover_sweep.live.verdict import judge
from rover_sweep.logs.log import Log
from rover_sweep.logs.read import read_logs, read_runs, runs_of
from rover_sweep.quality.faults import (
    TOO_SHORT,
    each_with_length,
    faults_of,
    needed,
    short_trials,
    too_short,
    with_length,
)
from rover_sweep.quality.relations import STRETCHED, Relation, stretched_by_arrival
from rover_sweep.quality.verdict import WHEEL_LOCK, assess

VEHICLE = NOMINAL.parents[1] / "rover.toml"
SAID = "of driving, but 16 s are needed (5 periods of 2 rad/s) for a random error of 10 %; drive one complete"


def piece(run: Recording, start: float, length: float) -> Recording:
    """A trial of `length` [s] from `start` [s] of the manoeuvre on, with nothing recorded around it."""
    begin = run.span[0] + start
    channels = {c: s.between(begin, begin + length) for c, s in run.channels.items()}
    return replace(run, span=(begin, begin + length), channels=channels, standstill=(), straight=())


@pytest.fixture(scope="module")
def runs() -> rs.Runs:
    return rs.read(NOMINAL / "run1.BIN", NOMINAL / "run2.BIN", vehicle=VEHICLE)


@pytest.mark.parametrize(("length", "start"), [(4.0, 2.0), (8.0, 20.0), (15.0, 40.0)])
def test_a_short_trial_is_named(runs: rs.Runs, length: float, start: float) -> None:
    (run,) = each_with_length([piece(runs[0], start, length)])
    (fault,) = (note for note in run.notes if note.fault)
    assert fault.fault == TOO_SHORT
    assert fault.text.startswith(f"too short: {length:.1f} s {SAID}")
    assert assess(run).sentence == f"repeat: {fault.text}" and not assess(run).keep


def test_no_model_of_a_short_trial_is_good(runs: rs.Runs) -> None:
    """4 s at the end of a sweep give nothing: of them nothing but a wrong sign of the steering was said."""
    assert runs.vehicle is not None
    geometry, bicycle = geometry_of(runs.vehicle), Settings(models=("bicycle",))
    found = identify([piece(runs[0], 44.0, 15.0)], geometry, (), bicycle)
    assert found.recommended is None and any(SAID in words for words in found.summary)
    assert {m.verdict.level for m in found.models.values()} <= {"poor", "not identifiable"}
    found = identify([piece(runs[1], 55.0, 4.0)], geometry, (), bicycle)
    assert found.summary[0].startswith("nothing can be identified: too short: 4.0 s")
    given = Material((piece(runs[0], 20.0, 8.0),), (runs[0],))
    refused = diagnosed(given, runs.vehicle, DiagnosisSettings())
    assert refused.verdict == "refused" and "too short: 8.0 s" in refused.sentence


def test_pieces_count_together(runs: rs.Runs) -> None:
    pieces = [piece(runs[0], start, 10.0) for start in (5.0, 20.0)]
    assert too_short(pieces[:1]) and too_short(pieces) is None
    assert with_length(pieces) == tuple(pieces)


def test_five_short_trials_are_repeats(runs: rs.Runs) -> None:
    """T_F/5 is the longest window, so that each trial is one average of its whole length."""
    crumbs = [piece(runs[0], start, 4.0) for start in range(5, 50, 4)]
    assert too_short(crumbs) is None and short_trials(crumbs)
    assert (fault := too_short(crumbs[:4])) and fault.text.startswith("too short: 4 runs of at most 4.0 s")
    assert too_short([piece(runs[0], start, 1.0) for start in range(5, 35)])
    assert needed(4.0) == pytest.approx(needed() / 2) and needed(0.3) == needed()


def test_what_was_driven_by_hand_counts_together(runs: rs.Runs) -> None:
    by_hand = [replace(piece(runs[0], start, 9.0), kind="other") for start in (5.0, 20.0)]
    assert each_with_length(by_hand) == tuple(by_hand)
    assert all(run.notes[-1].fault == TOO_SHORT for run in each_with_length(by_hand[:1]))
    doublet = replace(by_hand[0], kind="doublet")
    assert each_with_length([doublet]) == (doublet,)


# ---- Every command and screen says the same of one run, word for word.

DATA = Path(__file__).parents[1] / "data"
RUNS = ["ardurover-4.6.3/nominal/run1.BIN", "ardurover-4.6.3/defaults/run1.tlog"]


@pytest.mark.parametrize("name", RUNS)
def test_identify_coherence_session_and_python_agree(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, rover = DATA / name, DATA / "rover.toml"
    runs = rs.read(log, vehicle=rover)
    (python,) = runs.coherence()
    (identified,) = rs.identify(runs, models=["bicycle"], bootstrap=0).coherence
    session = judge(log, (0.0, 1e9), python.run, runs.vehicle)
    assert command(["coherence", str(log), "--vehicle", str(rover), "--json"]) == 0
    (told,) = json.loads(capsys.readouterr().out)
    said = {(v.advice, v.sentence) for v in (python, identified, session)} | {
        (told["advice"], told["sentence"])
    }
    assert len(said) == 1, said


def test_noise_changes_them_all_alike(tmp_path: Path) -> None:
    (run,) = rs.read(DATA / RUNS[0], vehicle=DATA / "rover.toml")
    noise = 3.0 * np.random.default_rng(1).standard_normal(run["ay"].x.size)
    noisy = replace(run, channels={**run.channels, "ay": replace(run["ay"], x=run["ay"].x + noise)})
    by_angle, by_pulse = assess(noisy), assess(noisy.without({"delta"}))
    assert by_angle.advice == "repeat" and "repeat with" in by_angle.sentence
    assert by_angle.sentence == by_pulse.sentence


# ---- The amplitude that is advised is in the unit of the recording, and within what the steering can do.

ENDS = {"SERVO1_MIN": 1300.0, "SERVO1_MAX": 1750.0, "SERVO1_TRIM": 1500.0}


def noisy(run: Recording, sd: float) -> Recording:
    noise = np.random.default_rng(1)
    return damaged(run, ay=lambda x: x + sd * noise.standard_normal(x.size))


def with_angle_alone(run: Recording, rad_per_us: float) -> Recording:
    pwm = run["pwm"]
    delta = replace(pwm, x=-(pwm.x - 1500) * rad_per_us, unit="rad")
    return replace(run.without({"pwm"}), channels={**run.without({"pwm"}).channels, "delta": delta})


def test_an_angle_is_advised_in_rad_and_within_the_lock(sweep: Recording) -> None:
    run = with_angle_alone(noisy(sweep, 60.0), 0.003)
    found = assess(run).next
    assert " us" not in found.sentence and " rad" in found.sentence
    assert all(band.amplitude <= WHEEL_LOCK for band in found.bands)
    assert found.amplitude is None or found.amplitude <= WHEEL_LOCK
    assert " allows " in assess(run).sentence and " us" not in assess(run).sentence


def test_no_advice_goes_beyond_the_stops(sweep: Recording) -> None:
    run = replace(noisy(sweep, 60.0), limits=ENDS)
    assert all(band.amplitude <= 200.0 for band in assess(run).next.bands)
    assert "the end stop (SERVO1_MIN and _MAX) allows 200 us" in assess(run).sentence
    low = assess(replace(run, limits={**ENDS, "SWP_PWM_MAX": 170.0})).next
    assert all(band.amplitude <= 170.0 for band in low.bands)
    usual = assess(replace(run, limits={})).next.bands  # a usual servo is assumed
    assert max(band.amplitude for band in usual) <= 500.0


# ---- Steering at its end stops is known as such, by its stays at one angle or by the vehicle file.

MAP = {"time": "t", "delta": "steer", "r": "r", "speed": "v"}
STOP = 0.34  # rad
ROVER = "[vehicle]\nmass = 3.0\ncg_to_front_axle = 0.16\ncg_to_rear_axle = 0.16\n"


def drive(tmp_path: Path, largest: float, recorded: float) -> str:
    """30 s by hand: commands up to `largest` [rad], recorded up to `recorded`; the wheels stop at `STOP`."""
    random = np.random.default_rng(2)
    t = np.arange(0, 30, 0.02)
    knots = np.cumsum(random.uniform(0.3, 0.9, 120))
    command = np.interp(t, knots, largest * random.uniform(-1, 1, knots.size))
    r = 2.0 * np.clip(command, -STOP, STOP) / 0.32
    steer = np.clip(command, -recorded, recorded)
    rows = np.column_stack((t, steer, r + 0.01 * random.standard_normal(t.size), np.full(t.size, 2.0)))
    path = tmp_path / "drive.csv"
    path.write_text("t,steer,r,v\n" + "\n".join(",".join(f"{x:.6g}" for x in row) for row in rows))
    return str(path)


def test_stays_at_equal_angles_are_the_stops(tmp_path: Path) -> None:
    (run,) = rs.read(drive(tmp_path, 0.5, STOP), columns=MAP)
    (note,) = (n for n in run.notes if "end stops" in n.text)
    assert "at 0.34 rad to either side" in note.text and note.level == "warning"


def test_steering_below_the_stops_gets_no_note(tmp_path: Path) -> None:
    (run,) = rs.read(drive(tmp_path, 0.3, 1.0), columns=MAP)
    assert not any("stop" in n.text for n in run.notes)


def test_the_wheels_stop_at_the_angle_of_the_vehicle_file(tmp_path: Path) -> None:
    source = drive(tmp_path, 0.5, 1.0)
    (tmp_path / "bare.toml").write_text(ROVER)
    (tmp_path / "rover.toml").write_text(ROVER + f"max_steering_angle = {STOP}\n")
    bare, known = (rs.read(source, columns=MAP, vehicle=tmp_path / f"{n}.toml") for n in ("bare", "rover"))
    assert np.max(np.abs(known[0]["delta"].x)) == pytest.approx(STOP)
    assert any("beyond max_steering_angle, 0.34 rad" in n.text for n in known[0].notes)
    wrong, right = (
        rs.identify(runs, bootstrap=0, models=["bicycle"]).models["kinematic"].fit["L_eff"].value
        for runs in (bare, known)
    )
    assert right == pytest.approx(0.32, rel=0.02) and wrong > 1.05 * right


# ---- A clock that runs too fast or too slow is named: by angles and rates, by SWEP.T, by times of arrival.

APPLET, TLOG = NOMINAL.parent / "applet" / "run1.BIN", NOMINAL.parent / "applet" / "run1.tlog"


def stretched(run: Recording, factor: float) -> Recording:
    """The run on a clock of which a second is `factor` true seconds."""
    channels = {c: replace(s, t=factor * s.t) for c, s in run.channels.items()}
    start, end = run.span
    return replace(run, channels=channels, span=(factor * start, factor * end), standstill=(), notes=())


@pytest.mark.parametrize("factor", [0.9, 1.5])
@pytest.mark.parametrize("roll", [True, False])
def test_angles_and_rates_tell(sweep: Recording, factor: float, roll: bool) -> None:
    run = sweep if roll else sweep.without({"p", "phi"})
    (fault,) = faults_of(stretched(run, factor if roll else factor**2))
    assert fault.fault == STRETCHED and {"r", "ay", "p"} <= set(fault.spoils)
    reported = float(fault.text.partition("stretched by ")[2].partition(":")[0])
    assert reported == pytest.approx(factor if roll else factor**2, rel=0.02)


@pytest.mark.parametrize("scale", [0.87, 1.3])
def test_gyros_of_another_scale_are_no_clock(sweep: Recording, scale: float) -> None:
    """a_y, which no clock changes, is then not V r; the diagnosis finds the scale."""
    wrong = {c: replace(sweep[c], x=scale * sweep[c].x) for c in ("r", "p")}
    run = replace(sweep, channels={**sweep.channels, **wrong}, notes=())
    assert not [fault for fault in faults_of(run) if fault.fault == STRETCHED]


@pytest.mark.parametrize("factor", [0.98, 3.0])
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


def test_no_model_of_a_stretched_run_is_good(log: Path) -> None:
    runs = rs.read(log, vehicle=VEHICLE)
    (verdict,) = runs.coherence()
    assert not verdict.keep and "the clock of this recording is stretched by 1.2:" in verdict.sentence
    result = rs.identify(runs, models=("bicycle",), bootstrap=0)
    assert result.recommended is None and "stretched" in " ".join(result.summary)
    assert {m.verdict.level for m in result.models.values()} <= {"poor", "not identifiable"}
    found = rs.diagnose(runs)
    assert found.verdict == "refused" and "stretched by 1.2" in found.sentence
