"""Exported models: every form gives back the frequency response of the structure."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io
import scipy.signal

from rover_sweep.cli.main import run
from rover_sweep.report.export.exported_model import (
    at_speed,
    exported_model,
    json_text,
    mat_file,
    matlab_text,
    python_text,
)

W = np.geomspace(0.2, 40, 40)
pytestmark = pytest.mark.filterwarnings("ignore:Badly conditioned")
MODELS = ("kinematic", "bicycle", "roll-yaw", "lumped")


def expected(case: Any, name: str, speed: float | None = None, filtered: bool = True) -> np.ndarray:
    """(n_w, n_outputs) of the structure."""
    fit = case.result.models[name].fit
    filters = case.result.groups[0].runs[0].filters if filtered else {}
    return np.column_stack(
        [fit.structure.response(W, speed or fit.speed, o, filters) for o in fit.structure.outputs]
    )


def rebuilt(model: dict[str, Any], filtered: bool = True) -> np.ndarray:
    """(n_w, n_outputs) by scipy.signal from A, B, C, D, tau and the filters."""
    columns = []
    for k, output in enumerate(model["outputs"]):
        rows = np.array(model["C"])[k : k + 1], np.array(model["D"])[k : k + 1]
        _, h = scipy.signal.freqresp(scipy.signal.StateSpace(model["A"], model["B"], *rows), W)
        h = h * np.exp(-1j * W * model["tau_s"])
        known = model["sensor_filters"].get(output)
        columns.append(h * scipy.signal.freqs(known["num"], known["den"], W)[1] if known and filtered else h)
    return np.column_stack(columns)


@pytest.mark.parametrize("name", MODELS)
def test_matrices_delay_and_filters_give_the_response_of_the_structure(nominal: Any, name: str) -> None:
    model = json.loads(json_text(exported_model(nominal.result, name)))
    np.testing.assert_allclose(rebuilt(model), expected(nominal, name), rtol=1e-6)
    np.testing.assert_allclose(rebuilt(model, False), expected(nominal, name, filtered=False), rtol=1e-6)
    assert len(model["states"]) == len(model["state_units"]) == len(model["A"])
    assert len(model["outputs"]) == len(model["output_units"]) == len(model["C"])


def test_descriptor_matrices_give_the_same(nominal: Any) -> None:
    model = exported_model(nominal.result, "roll-yaw")
    m, f, g, h0, h1 = (np.array(model[n]) for n in ("M", "F", "G", "H0", "H1"))
    for w, row in zip(W, expected(nominal, "roll-yaw", filtered=False), strict=True):
        x = np.linalg.solve(1j * w * m - f, g)
        y = (h0 + 1j * w * h1) @ x * np.exp(-1j * w * model["tau_s"])
        np.testing.assert_allclose(y[:, 0], row, rtol=1e-9)


@pytest.mark.parametrize("name", ["bicycle", "roll-yaw"])
def test_a_model_of_physical_parameters_moves_to_another_speed(nominal: Any, name: str) -> None:
    model = at_speed(exported_model(nominal.result, name), 4.0)
    assert model["speed_m_s"] == 4.0
    np.testing.assert_allclose(rebuilt(model), expected(nominal, name, 4.0), rtol=1e-6)


def test_the_lumped_model_stays_at_its_speed(nominal: Any) -> None:
    with pytest.raises(ValueError, match="speed of the identification"):
        at_speed(exported_model(nominal.result, "lumped"), 4.0)


def test_python_text_runs_on_its_own(nominal: Any) -> None:
    namespace: dict[str, Any] = {}
    exec(python_text(exported_model(nominal.result, "roll-yaw", (1500.0, 0.00095))), namespace)
    np.testing.assert_allclose(namespace["frequency_response"](W), expected(nominal, "roll-yaw"), rtol=1e-9)
    bare = namespace["frequency_response"](W, sensors=False)
    np.testing.assert_allclose(bare, expected(nominal, "roll-yaw", filtered=False), rtol=1e-9)
    assert "0.00095" in namespace["__doc__"]


def test_matlab_text_holds_the_matrices_to_the_last_digit(nominal: Any) -> None:
    model = exported_model(nominal.result, "roll-yaw")
    text = matlab_text(model)
    for name in ("A", "B", "C", "D", "M", "F", "G", "H0", "H1"):
        found = re.search(rf"^{name} = \[(.*)\];$", text, re.MULTILINE)
        assert found
        matrix = [[float(x) for x in row.split()] for row in found[1].split(";")]
        assert matrix == model[name]
    assert f"tau = {model['tau_s']!r};" in text and "'InputDelay', tau" in text
    assert text.count("sensors(") == 3  # r, ay and p have low-passes, vydot has none


def test_mat_file_holds_matrices_names_and_filters(nominal: Any, tmp_path: Path) -> None:
    model = exported_model(nominal.result, "roll-yaw")
    path = tmp_path / "model.mat"
    path.write_bytes(mat_file(model))
    content = scipy.io.loadmat(path, squeeze_me=True)
    np.testing.assert_array_equal(content["A"], model["A"])
    np.testing.assert_array_equal(content["H1"], model["H1"])
    assert list(content["states"]) == list(model["states"])
    assert float(content["tau"]) == model["tau_s"]
    assert float(content["sensor_filters"]["r"].item()["cutoff_hz"]) == 20
    assert float(content["parameters"]["Izz"]) == model["parameters"]["Izz"]


def test_command_takes_the_recommended_model_and_the_format_of_the_suffix(
    reports: dict[str, Path], nominal: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "rover.m"
    assert run(["export", str(reports["nominal"]), "-o", str(out)]) == 0
    assert out.read_text().startswith("% roll-yaw model at 2.45 m/s")
    assert capsys.readouterr().out == ""
    assert run(["export", str(reports["nominal"]), "--model", "bicycle", "--speed", "3"]) == 0
    model = json.loads(capsys.readouterr().out)
    assert (model["model"], model["speed_m_s"]) == ("bicycle", 3.0)
    np.testing.assert_allclose(rebuilt(model), expected(nominal, "bicycle", 3.0), rtol=1e-6)


@pytest.mark.parametrize(
    ("folder", "options", "code", "words"),
    [
        ("nominal", ["--model", "tricycle"], 2, "there are bicycle, kinematic, lumped, roll-yaw"),
        ("nominal", ["--model", "lumped", "--speed", "4"], 2, "valid only at 2.45 m/s"),
        ("nominal", ["-o", "model.doc"], 2, "no format is known for .doc"),
        ("nominal", ["--format", "mat"], 2, "cannot go to stdout"),
        ("stock", ["--model", "bicycle"], 3, "kinematic model fits as well"),
        ("stock", ["--model", "roll-yaw"], 3, "roll rate does not follow"),
    ],
)
def test_command_says_what_is_wrong(
    reports: dict[str, Path],
    folder: str,
    options: list[str],
    code: int,
    words: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert run(["export", str(reports[folder]), *options]) == code
    captured = capsys.readouterr()
    assert words in captured.err and captured.out == ""


def test_command_refuses_a_folder_without_a_report_and_a_damaged_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["export", str(tmp_path)]) == 2
    assert "holds no report" in capsys.readouterr().err
    (tmp_path / "identification.json").write_text('{"recommended": ')
    assert run(["export", str(tmp_path)]) == 3
    assert "damaged" in capsys.readouterr().err
