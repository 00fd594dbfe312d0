"""The model of a diagnosis: simulated, its linear part, its data form, its exports."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from augmented_models import SPEED, VEHICLE, linear_only, model, recording
from scipy.signal import bilinear, lfilter

import rover_sweep as rs
from rover_sweep.cli.main import run
from rover_sweep.data.vehicle_geometry import MODEL_NAMES
from rover_sweep.diagnosis.effects import every_form
from rover_sweep.diagnosis.linear import left_out, linear
from rover_sweep.diagnosis.result import Diagnosis
from rover_sweep.diagnosis.simulation.experiment import RATE, experiment
from rover_sweep.diagnosis.simulation.simulator import logged
from rover_sweep.identification.verify import simulated_outputs as linear_simulation
from rover_sweep.report.diagnosis.diagnosis_json import DiagnosisOrigin
from rover_sweep.report.diagnosis.report import write_diagnosis
from rover_sweep.report.export.augmented_model_json import augmented_document, augmented_from
from rover_sweep.report.export.exported_model import at_speed, exported_augmented, matlab_text, python_text
from rover_sweep.report.wording import strict_json

DERIVATIVES = {
    "Y_v": -60.0, "Y_p": 0.4, "Y_r": -0.3, "Y_phi": -25.0, "Y_delta": 27.0,
    "L_v": -230.0, "L_p": -12.0, "L_r": -1.0, "L_phi": -560.0, "L_delta": 100.0,
    "N_v": -12.0, "N_p": 0.01, "N_r": -38.0, "N_phi": 0.3, "N_delta": 96.0,
}  # fmt: skip
TINY = 0.004  # rad: small enough for the nonlinear simulation to be linear
CASES = {
    "second order servo": linear_only(lag_shape=0.3),
    "roll steer": linear_only("roll-yaw", "roll_steer"),
    "imu": linear_only("roll-yaw", "imu_offset", ay_lag=0.002, p_lag=-0.001),
    "tilt": linear_only("roll-yaw", "imu_tilt", bias_ay=0.0),
    "filter": linear_only("roll-yaw", "sensor_filter"),
    "velocity": linear_only("roll-yaw", "velocity_lag", vy_gain=0.05),
    "swinging servo": linear_only("roll-yaw", "servo_lag/second order"),
    "rear roll steer": linear_only("roll-yaw", "roll_steer/rear axle"),
    "compliance": linear_only("roll-yaw", "steering_compliance", "tyre_relaxation"),
    "yaw damping": linear_only("roll-yaw", "yaw_damping"),
    "yaw damping over speed": linear_only("bicycle", "yaw_damping/over r/V"),
    "scales": linear_only("roll-yaw", "sensor_scale", "imu_tilt", bias_ay=0.0),
    "first-order filter": linear_only("roll-yaw", "sensor_filter/first order"),
    "delayed sensors": linear_only("roll-yaw", "sensor_filter/delay", ay_lag=0.002),
    "no servo lag": linear_only(lag=0.0),
    "bicycle": linear_only("bicycle"),
    "bicycle with roll": linear_only("bicycle", "roll_dof"),
    "kinematic": linear_only("kinematic"),
    "lumped": linear_only("lumped", imu_x=0.02, imu_z=-0.01, **DERIVATIVES),
    "lumped with its lags": linear_only("lumped", "velocity_lag", ay_lag=0.001, **DERIVATIVES),
    "kinematic with roll": linear_only("kinematic", "roll_dof"),
    "kinematic with tyres": linear_only("kinematic", "tyre_slip", "tyre_relaxation"),
}


@pytest.mark.parametrize("case", CASES)
def test_small_motion_is_that_of_the_linear_part(case: str) -> None:
    """The engine's own nonlinear simulation at constant speed against the matrices, in the time domain."""
    chosen = CASES[case]
    run = experiment(recording())
    t = run.t
    steer = TINY * np.sin(2 * np.pi * (0.3 * t + 0.12 * t * t)) * np.minimum(1.0, t)
    straight = {c: np.zeros(t.size) for c in ("r", "ay", "p", "vy")}
    run = replace(
        run,
        steer=steer,
        commanded=None,
        speed=np.full(t.size, SPEED),
        measured=straight,
        filters=chosen.filters,
    )
    expected = logged(run, chosen.simulated, chosen.x)
    exported = exported_augmented(chosen, "explained", SPEED)
    fine = 10  # a held input is late by half a step
    held = np.interp(np.arange(fine * t.size) / (fine * RATE), t, steer)
    found = linear_simulation(linear(chosen), SPEED, held, fine * RATE, {})
    for channel in linear(chosen).outputs:
        y = found[channel][::fine]
        if fraction := exported["sensor_filters"].get(channel):
            y = _through(fraction, found[channel], fine * RATE)[::fine]
        measured = _slope(expected["vy"]) if channel == "vydot" else expected[channel]
        inside = slice(100, -200)
        size = max(float(np.sqrt(np.mean(measured[inside] ** 2))), 1e-9)
        error = float(np.sqrt(np.mean((y - measured)[inside] ** 2))) / size
        # the simulation takes a lag's input at the end of each of its steps of 5 ms, half a step early, and
        # its implicit Euler adds 0.025 to the damping ratio of a servo that swings at 20 rad/s
        room = 0.06 if case == "swinging servo" else 0.1 if "vy_lag" in linear(chosen).values else 0.03
        assert error < room, (channel, error)


def _slope(y: np.ndarray) -> np.ndarray:
    """dy/dt by five points: two lose 7 % of 10 Hz at this rate."""
    near = [np.roll(y, -k) for k in (-2, -1, 1, 2)]
    return (near[0] - 8 * near[1] + 8 * near[2] - near[3]) / (12 / RATE)


def _through(fraction: dict[str, list[float]], y: np.ndarray, rate: float) -> np.ndarray:
    return np.asarray(lfilter(*bilinear(fraction["num"], fraction["den"], rate), y))


def test_what_is_not_linear_is_said_inside_every_export() -> None:
    whole = model("steering_backlash", "tyre_relaxation", "cross_slope", trim=0.004, vscale=0.01)
    words = left_out(whole)
    assert words[0].startswith("steering_backlash (play operator of half gap b; b = 0.01 rad) is not linear")
    assert "cross_slope" in words[1] and "trim of the steering, 0.004 rad" in words[2]
    assert not any(word.startswith("tyre_relaxation") for word in words)
    exported = exported_augmented(whole, "explained")
    assert exported["speed_m_s"] == pytest.approx(SPEED * 1.01)
    for text in (strict_json(exported), matlab_text(exported), python_text(exported)):
        assert "steering_backlash (play operator" in text and "F_f" in text
    early = model("sensor_filter/first order, before the estimator")
    assert any("lag of the heading" in words for words in left_out(early))
    assert left_out(model("sensor_filter/first order")) == []


def test_an_export_moves_to_another_speed_and_runs_on_its_own() -> None:
    exported = json.loads(strict_json(exported_augmented(model("tyre_relaxation"), "explained")))
    moved = at_speed(exported, 3.0)
    assert moved == exported_augmented(model("tyre_relaxation"), "explained", 3.0)
    namespace: dict[str, object] = {}
    exec(python_text(moved), namespace)
    w = np.geomspace(0.3, 30, 20)
    h = namespace["frequency_response"](w, sensors=False)  # type: ignore[operator]
    structure = linear(model("tyre_relaxation"))
    for k, output in enumerate(structure.outputs):
        np.testing.assert_allclose(h[:, k], structure.response(w, 3.0, output), rtol=1e-6)


def test_the_data_form_keeps_every_model() -> None:
    for effect in set(every_form()) - {"tyre_slip", "roll_dof"}:
        whole = replace(model(effect), happened_in="run 2", happened_at=12.5)
        again = augmented_from(json.loads(strict_json(augmented_document(whole))))
        assert (again.x, again.numbers, again.rover) == (dict(whole.x), whole.numbers, whole.rover)
        assert (again.effects, again.steering, again.filters) == (
            *(whole.effects, whole.steering, whole.filters),
        )
        assert (again.wait, again.happened_in, again.happened_at) == (0.005, "run 2", 12.5)


WRONG: list[tuple[tuple[str, ...], object, str]] = [
    (("coordinates", "ln_C"), -1e9, "ln_C = -1e+09 is not between -20 and 20"),
    (("coordinates", "lag"), 1e9, "lag = 1e+09 is not"),
    (("coordinates", "tyre_relaxation.sigma"), 40.0, "tyre_relaxation.sigma = 40 is not"),
    (("coordinates", "ln_Izz"), float("nan"), "NaN is not a JSON number"),
    (("known", "mass"), -1e9, "known mass = -1e+09 is not"),
    (("known", "sprung_mass"), 0.0, "known sprung_mass = 0 must be above 0"),
    (("known", "h"), "high", "h: 'high' is not a number"),
    (("known", "h"), float("inf"), "Infinity is not a JSON number"),
    (("speed_m_s",), -2.0, "speed_m_s = -2 must be above 0"),
    (("steering", "rad_per_us"), 1e9, "rad_per_us = 1e+09 is not"),
    (("filters", "r", "cutoff_hz"), None, "cutoff_hz of r = None is not a number"),
    (("baseline",), "tricycle", "there is no baseline 'tricycle'"),
]


def written(folder: Path, *effects: str) -> Path:
    found = Diagnosis("none", "nothing is left out", "roll-yaw", model=model(*effects))
    return write_diagnosis(found, folder, DiagnosisOrigin()).document


def test_numbers_that_no_fit_ends_with_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = written(tmp_path, "tyre_relaxation")
    whole = file.read_text()
    assert run(["export", str(file)]) == 0
    for k, (place, value, said) in enumerate(WRONG):
        document: Any = json.loads(whole)
        entry = document["model"]
        for key in place[:-1]:
            entry = entry[key]
        assert place[-1] in entry
        entry[place[-1]] = value
        file.write_text(json.dumps(document))
        capsys.readouterr()
        assert run(["export", str(file), *(["--plant"] if k % 2 else [])]) in (2, 3)
        told = capsys.readouterr()
        assert said in told.err and not told.out and len(told.err.splitlines()) == 1


def test_a_saved_diagnosis_is_looked_at_as_well(tmp_path: Path) -> None:
    whole = model()
    for wrong in (
        replace(whole, x={**whole.x, "ln_C": float("nan")}),
        replace(whole, rover=replace(whole.rover, a=0.0)),
    ):
        found = rs.FullDiagnosis("none", "nothing", "roll-yaw", model=wrong)
        with pytest.raises(rs.UsageError, match=re.escape("found.json is damaged (")):
            rs.load_diagnosis(found.save(tmp_path / "found.json"))


def test_a_diagnosis_and_its_variant_give_the_same_rover_in_python(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """`export --python` of a diagnosis: the numbers in the file are those of its variant.toml."""
    effects = ("steering_backlash", "tyre_relaxation")
    document = written(tmp_path, *effects)
    for place, out in ((document, "one.py"), (tmp_path, "two.py")):
        assert run(["export", str(place), "--python", str(tmp_path / out)]) == 0
    one, two = ((tmp_path / name).read_text() for name in ("one.py", "two.py"))
    assert one.partition("from __future__")[2] == two.partition("from __future__")[2]
    assert "the numbers of diagnosis.json." in one and "the numbers of variant.toml." in two
    assert all(f"'{effect}': {{" in one for effect in effects)

    text = document.read_text()
    assert '"baseline": "roll-yaw"' in text
    document.write_text(text.replace('"baseline": "roll-yaw"', '"baseline": "lumped"'))  # no simulated rover
    (tmp_path / "variant.toml").unlink()
    capsys.readouterr()
    assert run(["export", str(tmp_path), "--python", str(tmp_path / "x.py")]) in (2, 3)
    told = capsys.readouterr().err
    assert len(told.splitlines()) == 1 and not (tmp_path / "x.py").exists()


def test_a_run_without_a_vehicle_file_is_simulated_by_the_numbers_of_the_diagnosis() -> None:
    whole, run = model("tyre_relaxation"), recording()
    bare = replace(run, channels={c: s for c, s in run.channels.items() if c != "delta"})
    first, second = rs.simulate(whole, run), rs.simulate(whole, bare)
    np.testing.assert_array_equal(first.signals["r"], second.signals["r"])
    assert first.table().title.startswith("run4 by the roll-yaw with tyre_relaxation model")
    assert first.error("r") < 0.15 * np.sqrt(np.mean(first.measured["r"] ** 2))
    with pytest.raises(rs.DataRefused, match="has no steering angle"):
        rs.simulate(replace(whole, steering=None), bare)
    with pytest.raises(rs.UsageError, match=r"the second argument \(int\) is not a recorded run"):
        rs.simulate(whole, 5)  # type: ignore[arg-type]
    assert set(MODEL_NAMES.values()) >= {"m", "a", "b"} and VEHICLE.mass.value == whole.numbers["m"]
