"""Recordings of the real firmware: what is found in them, its curves, and the rover that it makes."""

from __future__ import annotations

import json
import tomllib
from dataclasses import replace
from io import StringIO
from math import log
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

import rover_sweep as rs
from rover_sweep.cli.main import run
from rover_sweep.data.plausibility import implausible
from rover_sweep.data.vehicle_file import Measured, load
from rover_sweep.data.vehicle_geometry import geometry_of
from rover_sweep.diagnosis.result import LawCurve
from rover_sweep.diagnosis.simulation.candidates import physical_numbers
from rover_sweep.report.charts.diagnosis_charts import curves_chart
from rover_sweep.report.diagnosis.report import diagnosis_report
from rover_sweep.report.on_terminal import on_terminal

DATA = Path(__file__).parents[1] / "data"
SETS = DATA / "concealed-ardurover"
RELAXING = SETS / "c"
RUN4 = str(RELAXING / "run4.BIN")


def runs_of(name: str, *numbers: int) -> rs.Runs:
    return rs.read(*(SETS / name / f"run{k}.BIN" for k in numbers), vehicle=SETS / name / "rover.toml")


def diagnosed_by_command(folder: Path, numbers: str, vehicle: Path, out: Path, *words: str) -> dict:
    """diagnosis.json of these runs of a folder, run 4 held out."""
    runs = [str(folder / f"run{k}.BIN") for k in numbers]
    given = ["--hold-out", str(folder / "run4.BIN"), "--vehicle", str(vehicle), "--out", str(out), *words]
    assert run(["diagnose", *runs, *given]) == 0
    return json.loads((out / "diagnosis.json").read_text())


@pytest.mark.slow
@pytest.mark.parametrize("name", "acf")
def test_the_concealed_effect_is_named_and_pays_on_the_fresh_run(name: str, tmp_path: Path) -> None:
    answer = diagnosed_by_command(SETS / name, "123", SETS / name / "rover.toml", tmp_path / "out")
    truth = DATA / "concealed-ardurover-truth" / f"{name}.toml"
    hidden = tomllib.loads(truth.read_text())["concealed"]
    assert [f["effect"] for f in answer["findings"]] == hidden
    assert answer["verdict"] == ("explained" if hidden else "none")
    for finding in answer["findings"]:
        assert finding["held_out"]["share_removed"] > 0.4
        assert finding["look_alikes"] == []
    if name == "f":  # backlash
        places = {(m["channel"], m["condition"]): m["residual_over_noise"] for m in answer["mismatch"]}
        assert places["r", "3rd harmonic"] > 3 and ("r", "hardly grows with amplitude") in places


@pytest.mark.slow
def test_a_kinematic_simulation_lacks_tyres_and_roll(tmp_path: Path) -> None:
    """ArduPilot's own rover as the simulation, a rover with tyres and springs as the recording."""
    firmware = DATA / "ardurover-4.6.3"
    words = ["--simulation", str(firmware / "stock" / "run1.BIN")]
    answer = diagnosed_by_command(firmware / "nominal", "123", DATA / "rover.toml", tmp_path / "out", *words)
    found = {f["effect"]: f["parameters"] for f in answer["findings"]}
    assert set(found) == {"tyre_slip", "roll_dof"}
    assert found["roll_dof"]["k_phi"]["value"] == pytest.approx(10.8, rel=0.08)
    assert found["tyre_slip"]["Izz"]["value"] == pytest.approx(0.071, rel=0.08)
    assert answer["held_out"][0]["share_removed"] > 0.7  # together; each alone leaves the other's error


@pytest.mark.slow
def test_a_trim_and_a_rate_limit_are_named_beside_derivatives(tmp_path: Path) -> None:
    words = ["--baseline", "lumped"]
    answer = diagnosed_by_command(SETS / "d", "123", SETS / "d" / "rover.toml", tmp_path / "out", *words)
    assert answer["baseline"] == "lumped"
    assert {f["effect"] for f in answer["findings"]} == {"steering_trim", "servo_rate_limit"}
    assert answer["held_out"][0]["share_removed"] > 0.7
    assert {"tyre_relaxation", "roll_steer", "imu_tilt"} <= {u["effect"] for u in answer["cannot_see"]}


@pytest.mark.slow
def test_without_the_true_effect_no_other_effect_is_found() -> None:
    """Set e hides dry friction of the suspension: no other effect may be reported for it."""
    found = rs.diagnose(runs_of("e", 1, 2), only=("steering_backlash", "roll_steer", "imu_offset"))
    assert found.verdict == "unexplained" and found.unknown is not None and not found.findings


# ---- Tyres that relax: the rover that is simulated with what was found.


@pytest.fixture(scope="module")
def diagnosed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a diagnosis of one sweep; run 4, at another speed, plays no part in the fit."""
    out = tmp_path_factory.mktemp("diagnosed") / "out"
    words = ["--only", "tyre_relaxation,steering_backlash"]
    diagnosed_by_command(RELAXING, "3", RELAXING / "rover.toml", out, *words)
    return out


def errors(recording: Path) -> dict[str, float]:
    """RMS of what was measured in run 4 less what stands in a recording of a simulation of it."""
    (measured,), (simulated,) = rs.read(RUN4), rs.read(recording)
    real = {channel: measured.manoeuvre(channel) for channel in ("r", "ay")}
    return {c: float(np.sqrt(np.mean((simulated[c].on(y.t) - y.x) ** 2))) for c, y in real.items()}


def test_the_diagnosed_rover_drives_run_4_as_it_was_and_the_nominal_does_not(
    diagnosed: Path, tmp_path: Path
) -> None:
    variants = {
        "nominal": ["nominal", "--vehicle", str(RELAXING / "rover.toml")],
        "diagnosed": [str(diagnosed / "variant.toml")],
    }
    found = {}
    for name, words in variants.items():
        out = tmp_path / f"{name}.BIN"
        assert run(["redrive", RUN4, "--simulator", "plant", "--variant", *words, "--out", str(out)]) == 0
        found[name] = errors(out)
    # measured .31 and .68: of the ground's bumps neither drive knows the other's
    for channel, room in {"r": 0.45, "ay": 0.80}.items():
        assert found["diagnosed"][channel] < room * found["nominal"][channel]


def test_a_diagnosis_is_read_back_from_its_report_and_simulates(diagnosed: Path) -> None:
    found = rs.load_diagnosis(diagnosed / "diagnosis.json")
    (fresh,) = rs.read(RUN4, vehicle=RELAXING / "rover.toml")
    document = json.loads((diagnosed / "diagnosis.json").read_text())
    assert [f.effect for f in found.findings] == ["tyre_relaxation"] == document["model"]["effects"]
    assert found.findings[0].parameters[0].value == pytest.approx(0.2276, rel=0.1)
    assert found.findings[0].held_out[0].share_removed == pytest.approx(1.0, abs=0.1)
    assert found.model is not None
    without = replace(found, model=replace(found.model, effects=()))
    assert rs.simulate(found, fresh).error("r") < 0.35 * rs.simulate(without, fresh).error("r")
    assert "tyre_relaxation" in repr(found) and rs.load_diagnosis(diagnosed).sentence == found.sentence


def test_export_writes_every_form(
    diagnosed: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("model.m", "model.py", "model.mat", "model.json"):
        assert run(["export", str(diagnosed), "-o", str(tmp_path / name)]) == 0
    exported = json.loads((tmp_path / "model.json").read_text())
    assert exported["model"] == "roll-yaw with tyre_relaxation" and {"F_f", "F_r"} <= set(exported["states"])
    capsys.readouterr()
    assert run(["export", str(diagnosed / "diagnosis.json"), "--speed", "3"]) == 0
    assert json.loads(capsys.readouterr().out)["speed_m_s"] == 3.0
    assert run(["export", str(diagnosed), "--plant"]) == 0
    assert capsys.readouterr().out == (diagnosed / "variant.toml").read_text()
    for words, said in (
        (["--plant", "-o", "x.json"], "a simulated rover is a TOML file"),
        (["--plant", "--speed", "3"], "--plant always writes TOML"),
        (["--model", "bicycle"], "has only the model"),
    ):
        assert run(["export", str(diagnosed), *words]) == 2
        assert said in capsys.readouterr().err


def test_a_plant_takes_a_diagnosis(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["export", str(tmp_path), "--plant"]) == 2
    assert "holds no diagnosis" in capsys.readouterr().err
    (tmp_path / "diagnosis.json").write_text('{"format": "rover-sweep diagnosis", "format_version": 1}')
    assert run(["export", str(tmp_path), "--plant"]) == 2
    assert "is damaged" in capsys.readouterr().err


# ---- Play in the steering: the curves of the answer agree with its numbers, and the report shows them.


@pytest.fixture(scope="module")
def with_play() -> rs.FullDiagnosis:
    return rs.diagnose(runs_of("f", 1), baseline="roll-yaw", only=["steering_backlash"])


def curve(found: rs.FullDiagnosis, place: str) -> LawCurve:
    return next(c for c in found.curves if c.place == place)


def test_play_is_the_gap_of_the_steering_loop(with_play: rs.FullDiagnosis) -> None:
    loop = curve(with_play, "steering")
    half = len(loop.x) // 2
    up, down = np.array(loop.y[:half]), np.array(loop.y[half:])[::-1]
    assert loop.x[:half] == loop.x[half:][::-1]
    gap = with_play.findings[0].parameters["b"].value
    assert np.median(down - up) == pytest.approx(2.0 * gap, rel=0.01)
    assert np.all(np.array(loop.low) <= loop.y) and np.all(np.array(loop.high) >= loop.y)


def test_the_slope_of_a_tyre_is_its_cornering_stiffness(with_play: rs.FullDiagnosis) -> None:
    for place, name in (("side force front", "Cf"), ("side force rear", "Cr")):
        tyre = curve(with_play, place)
        x, y = np.array(tyre.x), np.array(tyre.y)
        middle = np.argsort(np.abs(x))[:5]
        slope = -np.polyfit(x[middle], y[middle], 1)[0]
        number = with_play.parameters[name]
        assert number.low is not None and number.high is not None and number.low < slope < number.high
        assert x[0] < 0.0 < x[-1] and y[0] > 0.0 > y[-1]


def test_the_curves_are_in_the_report_in_its_json_on_a_terminal_and_in_matplotlib(
    with_play: rs.FullDiagnosis, tmp_path: Path
) -> None:
    with_play.report(tmp_path)
    assert rs.load_diagnosis(tmp_path).curves == with_play.curves
    assert 'id="curves"' in (tmp_path / "diagnosis.html").read_text()
    steering, *tyres = curves_chart(with_play.curves).stacks
    up, down = (line.y for line in steering.panels[0].lines if line.label == "fitted law")
    assert np.nanmax(down - up) > with_play.findings[0].parameters["b"].value  # both ways of the loop
    assert len(tyres) == 2 and all(len(stack.panels[0].spreads) == 1 for stack in tyres)
    console = Console(file=StringIO(), width=80)
    console.print(on_terminal(diagnosis_report(with_play)))
    drawn = console.file.getvalue()  # type: ignore[attr-defined]
    loop = drawn[drawn.index("steering, rad, over command, rad") :].splitlines()[1:8]
    assert all(line.count("┤") == 1 for line in loop) and any(chr(0x2800) < c for c in loop[3])
    assert "side force front, N" not in drawn  # as straight as its middle
    labels = ["command, rad", "slip angle front, rad", "slip angle rear, rad"]
    assert [axes.get_xlabel() for axes in with_play.plot_curves()] == labels


# ---- A diagnosis whose numbers are absurd says so first, and explains nothing.


def test_the_coordinates_of_a_model_are_judged_as_physical_numbers() -> None:
    geometry = geometry_of(load(DATA / "rover.toml"))
    x = {"ln_C": log(30.0), "ln_ratio": 0.2, "ln_Izz": log(0.07), "ln_k_phi": log(10.0), "ln_Ixx": 0.1}
    found = physical_numbers({**x, "ln_h": 0.05, "scale": 0.03}, geometry)
    assert found["Cf"] / found["Cr"] == pytest.approx(1.2214, rel=1e-3)
    assert found["steering_scale"] == 1.03 and implausible(geometry, found) == ()
    odd = physical_numbers({**x, "ln_Izz": log(0.49), "scale": 1.0}, geometry)
    assert [words.partition(" is ")[0] for words in implausible(geometry, odd)] == [
        "Izz = 0.49 kg m^2",
        "a steering scale of 2 times rad_per_us",
    ]


def test_an_implausible_file_is_said_first_and_nothing_is_explained() -> None:
    runs = rs.read(DATA / "ardurover-4.6.3/nominal/run3.BIN", vehicle=DATA / "rover.toml")
    assert runs.vehicle is not None
    heavy = rs.Runs(tuple(runs), replace(runs.vehicle, mass=Measured(26.6)))
    found = rs.diagnose(heavy, only=["servo_lag"], baseline="roll-yaw")
    assert found.sentence.startswith("the vehicle file is implausible: sprung mass / mass is 0.09")
    assert found.verdict == "unexplained"
