"""identification.json against its contract."""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

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


def test_costs_name_all_four_responses_and_average_those_that_were_fitted(document: dict[str, Any]) -> None:
    cost = document["models"]["roll-yaw"]["cost"]
    assert cost["fitted"] == ["r", "ay", "p"]
    assert cost["average"] == pytest.approx((cost["r"] + cost["ay"] + cost["p"]) / 3)
    assert cost["average_all"] == pytest.approx((cost["r"] + cost["ay"] + cost["p"] + cost["vydot"]) / 4)
    bicycle = document["models"]["bicycle"]["cost"]
    assert bicycle["p"] is None
    assert bicycle["average"] == pytest.approx((bicycle["r"] + bicycle["ay"]) / 2)


def test_verification_is_that_of_the_first_run_and_can_be_recomputed_from_its_channels(
    document: dict[str, Any],
) -> None:
    model = document["models"]["roll-yaw"]
    assert model["verification"] == model["verification_runs"][0]
    channels = model["verification"]["channels"]
    assert list(channels) == ["r", "ay", "p"]
    squares = [c["j_rms"] ** 2 for c in channels.values()]
    assert model["verification"]["j_rms"] == pytest.approx(math.sqrt(sum(squares) / 3))
    assert 0 < model["verification"]["tic"] < 0.07


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


def test_speed_inertia_and_versions(document: dict[str, Any], nominal: Any) -> None:
    assert document["speed_m_s"] == pytest.approx(2.45, abs=0.05)
    inertia = document["inertia"]
    found = nominal.result.models["roll-yaw"].fit["Izz"].value
    assert inertia["vehicle_file"] == {"value": 0.069, "sd": 0.003}
    assert inertia["models"]["roll-yaw"]["difference_percent"] == pytest.approx(100 * (found / 0.069 - 1))
    assert document["versions"]["numpy"] == np.__version__
    assert document["recommended"] == "roll-yaw"


def test_variants_and_reduction_stand_beside_the_fit(document: dict[str, Any]) -> None:
    variants = document["models"]["roll-yaw"]["variants"]
    assert {"filters ignored", "four responses", "Cf and Cr free"} <= set(variants)
    assert set(variants["Cf and Cr free"]["parameters"]) >= {"Cf", "Cr"}
    assert variants["four responses"]["cost"]["fitted"] == ["r", "ay", "vydot", "p"]
    steps = document["models"]["lumped"]["reduction"]
    dropped = {s["parameter"] for s in steps if s["dropped"]}
    parameters = document["models"]["lumped"]["parameters"]
    assert dropped and all(parameters[p]["value"] == 0 and not parameters[p]["free"] for p in dropped)


def test_poles_are_those_of_the_matrices(document: dict[str, Any], nominal: Any) -> None:
    fit = nominal.result.models["roll-yaw"].fit
    told = sorted(p["re"] for p in document["models"]["roll-yaw"]["poles"])
    assert told == pytest.approx(sorted(fit.structure.poles(fit.speed).real))


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


def test_the_same_result_gives_the_same_text(nominal: Any) -> None:
    assert strict_json(identification_document(*nominal)) == strict_json(identification_document(*nominal))


def test_numbers_that_are_not_finite_become_null_and_foreign_objects_are_refused() -> None:
    told = plain({"a": np.array([1.0, np.nan]), "b": (np.inf, np.int64(3)), "c": np.bool_(True)})
    assert told == {"a": [1.0, None], "b": [None, 3], "c": True}
    with pytest.raises(TypeError, match="complex"):
        plain({"pole": 1j})


def test_json_text_reads_back_whatever_its_layout() -> None:
    value = {
        "words": ["a", "b"],
        "long": ["x" * 40, "é"],
        "rows": [[1, 2], []],
        "none": {},
        "deep": {"k": [{"a": 1}]},
    }
    assert json.loads(strict_json(value)) == value


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
