"""identification.json against its contract."""

from __future__ import annotations

import hashlib
import json
import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io
import scipy.signal

from rover_sweep.cli.main import run as program
from rover_sweep.report.export.exported_model import (
    at_speed,
    exported_model,
    json_text,
    mat_file,
    matlab_text,
    python_text,
)
from rover_sweep.report.identification.identification_json import identification_document
from rover_sweep.report.wording import plain, strict_json

NOMINAL = Path(__file__).parents[1] / "data" / "ardurover-4.6.3" / "nominal"


def refuse(constant: str) -> None:
    raise ValueError(f"{constant} is not JSON")


def written(case: Any) -> dict[str, Any]:
    """The document as another program reads it."""
    return json.loads(strict_json(identification_document(*case)), parse_constant=refuse)


@pytest.fixture(scope="module")
def document(nominal: Any) -> dict[str, Any]:
    return written(nominal)


def test_every_parameter_has_the_keys_of_the_contract_and_the_values_of_the_fit(
    document: dict[str, Any], nominal: Any
) -> None:
    assert set(document["models"]) == {"kinematic", "bicycle", "roll-yaw", "lumped"}
    for name, model in document["models"].items():
        fit = nominal.result.models[name].fit
        own = [n for n, p in model["parameters"].items() if "variant" not in p]
        assert own == [e.name for e in fit.estimates]
        for e in fit.estimates:
            told = model["parameters"][e.name]
            assert (told["value"], told["unit"], told["free"]) == (e.value, e.unit, e.free)
            assert told["cr_percent"] == e.cr_percent
            assert told["insensitivity_percent"] == e.insensitivity_percent


def test_verification_is_that_of_the_first_run_and_can_be_recomputed_from_its_channels(
    document: dict[str, Any], nominal: Any
) -> None:
    model = document["models"]["roll-yaw"]
    assert model["verification"] == model["verification_runs"][0]
    channels = model["verification"]["channels"]
    assert list(channels) == ["r", "ay", "p"]
    squares = [c["j_rms"] ** 2 for c in channels.values()]
    assert model["verification"]["j_rms"] == pytest.approx(math.sqrt(sum(squares) / 3))
    assert 0 < model["verification"]["tic"] < 0.07
    fit = nominal.result.models["roll-yaw"].fit
    assert sorted(p["re"] for p in model["poles"]) == pytest.approx(
        sorted(fit.structure.poles(fit.speed).real)
    )
    inertia = document["inertia"]
    assert inertia["vehicle_file"] == {"value": 0.069, "sd": 0.003}
    percent = 100 * (fit["Izz"].value / 0.069 - 1)
    assert inertia["models"]["roll-yaw"]["difference_percent"] == pytest.approx(percent)
    assert document["speed_m_s"] == nominal.result.speed and document["recommended"] == "roll-yaw"


def test_runs_tell_their_bands_verdicts_and_input_hashes(document: dict[str, Any]) -> None:
    assert [run["name"] for run in document["runs"]] == ["run1", "run2"]
    for run in document["runs"]:
        assert run["verdict"] == "keep" and run["sentence"].startswith("keep")
        assert set(run["coherence"]) == {"r", "ay", "vydot", "p"}
        low, high = run["coherence"]["r"]["band"]
        assert low < 0.5 and high > 20
        content = (NOMINAL / f"{run['name']}.BIN").read_bytes()
        assert run["sources"][0]["sha256"] == hashlib.sha256(content).hexdigest()
        assert run["filters"]["r"]["cutoff_hz"] == 20
    assert document["verification_recordings"][0]["name"] == "run4"


def test_tyres_of_a_kinematic_rover_are_null_with_a_reason_and_the_rejected_numbers_apart(stock: Any) -> None:
    document = written(stock)
    assert document["recommended"] == "kinematic"
    bicycle = document["models"]["bicycle"]
    for name in ("C", "Izz", "tau"):
        told = bicycle["parameters"][name]
        assert told["value"] is None and told["cr_percent"] is None
        assert "kinematic model fits as well" in told["reason"]
        assert told["rejected"]["value"] == stock.result.models["bicycle"].fit[name].value
        for variant in bicycle["variants"].values():
            assert variant["parameters"].get(name, {"value": None})["value"] is None
    assert bicycle["parameters"]["m"]["value"] == 2.66
    assert document["models"]["kinematic"]["parameters"]["L_eff"]["value"] > 0.3
    assert "bicycle" not in document["inertia"]["models"]
    assert "roll-yaw" in document["refused"]


def test_numbers_that_are_not_finite_become_null_and_foreign_objects_are_refused() -> None:
    value = {"long": ["x" * 40, "é"], "rows": [[1, 2], []], "none": {}, "deep": {"k": [{"a": 1}]}}
    assert json.loads(strict_json(value)) == value
    told = plain({"a": np.array([1.0, np.nan]), "b": (np.inf, np.int64(3)), "c": np.bool_(True)})
    assert told == {"a": [1.0, None], "b": [None, 3], "c": True}
    with pytest.raises(TypeError, match="complex"):
        plain({"pole": 1j})


def test_runs_of_the_same_name_keep_their_own_verdicts(nominal: Any) -> None:
    group, (first, second) = nominal.result.groups[0], nominal.result.coherence
    runs = tuple(replace(run, name="log") for run in group.runs)
    verdicts = (
        replace(first, run="log", sentence="of the first"),
        replace(second, run="log", sentence="of the second"),
    )
    result = replace(nominal.result, groups=(replace(group, runs=runs),), coherence=verdicts)
    document = identification_document(result, nominal.provenance)
    assert [run["sentence"] for run in document["runs"]] == ["of the first", "of the second"]


# ---- Exported models: every form gives back the frequency response of the structure.

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


def test_a_model_of_physical_parameters_moves_to_another_speed_and_the_lumped_one_does_not(
    nominal: Any,
) -> None:
    for name in ("bicycle", "roll-yaw"):
        model = at_speed(exported_model(nominal.result, name), 4.0)
        assert model["speed_m_s"] == 4.0
        np.testing.assert_allclose(rebuilt(model), expected(nominal, name, 4.0), rtol=1e-6)
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
    reports: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "rover.m"
    assert program(["export", str(reports["nominal"]), "-o", str(out)]) == 0
    assert out.read_text().startswith("% roll-yaw model at 2.45 m/s")
    assert capsys.readouterr().out == ""
    assert program(["export", str(reports["nominal"]), "--model", "bicycle", "--speed", "3"]) == 0
    model = json.loads(capsys.readouterr().out)
    assert (model["model"], model["speed_m_s"]) == ("bicycle", 3.0)
    (tmp_path / "identification.json").write_text('{"recommended": ')
    for folder, code, words in ((tmp_path / "empty", 2, "holds no report"), (tmp_path, 3, "damaged")):
        folder.mkdir(exist_ok=True)
        assert program(["export", str(folder)]) == code and words in capsys.readouterr().err


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
    assert program(["export", str(reports[folder]), *options]) == code
    captured = capsys.readouterr()
    assert words in captured.err and captured.out == ""
