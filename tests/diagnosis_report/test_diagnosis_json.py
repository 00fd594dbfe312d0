"""diagnosis.json against the contract of the issue."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import pytest
from fabricated_diagnoses import ALL, EXPLAINED, NONE, PARTLY

from rover_sweep.diagnosis.result import Diagnosis, Unseen, UpperBound
from rover_sweep.report.diagnosis.diagnosis_json import DiagnosisOrigin, diagnosis_document, diagnosis_from
from rover_sweep.report.wording import strict_json

NUMBER = (int, float)
MAYBE = (int, float, type(None))
FIT = {"j_rms": NUMBER, "tic": NUMBER}
SCHEMA: dict[str, Any] = {
    "verdict": {"none", "explained", "partly explained", "unexplained", "refused"},
    "mismatch": [
        {
            "channel": {"r", "ay", "p", "vy"},
            "band_rad_s": [NUMBER],
            "condition": str,
            "residual_over_noise": NUMBER,
            "sentence": str,
        }
    ],
    "findings": [
        {
            "effect": str,
            "look_alikes": [str],
            "evidence": (dict, NUMBER),
            "next_run": str,
            "parameters": (dict, {"value": NUMBER, "unit": str, "low": MAYBE, "high": MAYBE}),
            "held_out": (None, {"run": str, "before": FIT, "after": FIT, "share_removed": MAYBE}),
        }
    ],
    "unknown": (None, {"channel": str, "depends_on": str, "residual_over_noise": NUMBER, "sentence": str}),
    "cannot_see": [{"effect": str, "why": str}],
}


def check(value: Any, schema: Any, where: str) -> None:
    """Every key of the schema is there with its type; (dict, s): any keys with s; (None, s): null or s."""
    match schema:
        case dict():
            assert isinstance(value, dict) and set(schema) <= set(value), where
            for key, part in schema.items():
                check(value[key], part, f"{where}.{key}")
        case list():
            assert isinstance(value, list), where
            for k, item in enumerate(value):
                check(item, schema[0], f"{where}[{k}]")
        case set():
            assert value in schema, where
        case (first, part) if first is dict:
            assert isinstance(value, dict), where
            for key, item in value.items():
                check(item, part, f"{where}.{key}")
        case (None, part):
            if value is not None:
                check(value, part, where)
        case _:
            assert isinstance(value, schema) and not isinstance(value, bool), where


def written(found: Diagnosis) -> dict[str, Any]:
    document: dict[str, Any] = json.loads(strict_json(diagnosis_document(found, DiagnosisOrigin())))
    return document


@pytest.mark.parametrize("verdict", ALL)
def test_every_verdict_keeps_the_contract(verdict: str) -> None:
    document = written(ALL[verdict])
    check(document, SCHEMA, "diagnosis")
    assert document["verdict"] == verdict
    assert all(len(m["band_rad_s"]) == 2 for m in document["mismatch"])


def test_the_schema_of_this_test_can_fail() -> None:
    broken = written(EXPLAINED)
    broken["findings"][0]["parameters"]["b"]["unit"] = None
    with pytest.raises(AssertionError, match="findings.0..parameters.b.unit"):
        check(broken, SCHEMA, "diagnosis")


def test_the_numbers_are_those_of_the_diagnosis() -> None:
    finding = written(EXPLAINED)["findings"][0]
    numbers = {"value": 0.0083, "unit": "rad", "low": 0.0071, "high": 0.0094}
    assert finding["parameters"]["b"] == {**numbers, "meaning": "half the gap of the play"}
    assert finding["evidence"] == {"gain": 412.0, "threshold": 21.4, "probability:steering_deadband": 0.31}
    assert [h["run"] for h in finding["held_out_all"]] == ["run4", "run5"]
    open_ended = written(PARTLY)["findings"][1]["parameters"]["sigma"]
    assert open_ended["low"] == 0.24 and open_ended["high"] is None


def test_held_out_is_that_of_the_run_with_the_most_data() -> None:
    """run4 has overlays, run5 has none; and the other way round."""
    assert written(EXPLAINED)["findings"][0]["held_out"]["run"] == "run4"
    renamed = tuple(replace(o, run="run5") for o in EXPLAINED.overlays)
    assert written(replace(EXPLAINED, overlays=renamed))["findings"][0]["held_out"]["run"] == "run5"


def test_nothing_to_remove_is_null() -> None:
    assert written(NONE)["held_out"][0]["share_removed"] is None
    assert written(NONE)["unknown"] is None and written(NONE)["findings"] == []


def test_bounds_are_read_as_they_were_written_and_may_be_missing() -> None:
    up_to = {"ratio": UpperBound("-", 0.71, 1.21, 1.16)}
    bounded = Unseen("front_rear_stiffness", "a smaller one may not show in these runs", up_to, 0.1)
    found = replace(NONE, cannot_see=(*NONE.cannot_see, bounded))
    document = written(found)
    numbers = {"value": 0.71, "unit": "-", "low": 0.71, "high": 1.21, "matters": 1.16}
    assert document["cannot_see"][-1]["up_to"] == {"ratio": numbers}
    assert diagnosis_from(document, "it").cannot_see == found.cannot_see
    document["cannot_see"] = [{"effect": u.effect, "why": u.why} for u in NONE.cannot_see]
    assert diagnosis_from(document, "it").cannot_see == NONE.cannot_see


def test_the_form_of_a_finding_is_read_as_it_was_written_and_may_be_missing() -> None:
    one = EXPLAINED.findings[0]
    with_form = replace(one, form="smooth hysteresis")
    found = replace(EXPLAINED, findings=(with_form,))
    document = written(found)
    assert document["findings"][0]["form"] == "smooth hysteresis"
    assert diagnosis_from(document, "it").findings == (with_form,)
    del document["findings"][0]["form"]
    assert diagnosis_from(document, "it").findings == (one,)
