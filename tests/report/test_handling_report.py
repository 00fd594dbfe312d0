"""Handling in the report: the same numbers in the document, the table and the page; warnings where due."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import pytest

from rover_sweep.report.identification.identification_json import identification_document
from rover_sweep.report.identification.sentences import handling_notes, handling_table, to_do
from rover_sweep.report.wording import strict_json


def test_document_and_table_hold_the_quantities(nominal: Any, reports: Any) -> None:
    document = json.loads(strict_json(identification_document(*nominal)))["handling"]
    found = nominal.result.handling["roll-yaw"]
    told = document["models"]["roll-yaw"]
    assert told["quantities"]["yaw_frequency"]["value"] == found["yaw_frequency"].value
    assert told["quantities"]["understeer_gradient_deg_per_g"]["unit"] == "deg/g"
    assert told["identified"] is False
    assert {f"{m}{v}" for m in ("bicycle", "roll-yaw") for v in ("", ", Cf and Cr free")} <= set(
        document["models"]
    )
    assert not document["models"]["roll-yaw, Cf and Cr free"]["tied"]
    table = handling_table(nominal.result)
    assert table and table.headings[2:] == ("Bicycle", "Roll-yaw")
    assert any(row[0].text == "roll mode, frequency" and row[2].text == "–" for row in table.rows)
    assert not any(row[0].text in ("critical speed", "characteristic speed") for row in table.rows)
    assert "not identified by these runs" in table.note
    assert "Handling at 2.45 m/s" in (reports["nominal"] / "report.html").read_text()
    assert document["notes"] == []


def test_the_recorded_rover_is_nearly_neutral(nominal: Any) -> None:
    """Its tyres of 31.0 and 33.5 N/rad at .203 and .188 m make K_us .02 deg/g; b - a alone says -1.9."""
    for model in ("bicycle", "roll-yaw"):
        k = nominal.result.handling[f"{model}, Cf and Cr free"]["understeer_gradient_deg_per_g"]
        assert k.low < 0.02 < k.high and k.high - k.low < 11
    tied = nominal.result.handling["roll-yaw, one C for both axles"]
    assert tied["understeer_gradient_deg_per_g"].value == pytest.approx(-1.8, abs=0.2)
    assert not tied.identified and "b - a" in tied.sentence
    assert {"Cf", "Cr"} <= set(nominal.result.models["roll-yaw"].fit.structure.values)


def test_tyres_that_cannot_be_identified_have_no_handling(stock: Any) -> None:
    assert stock.result.handling == {} and handling_table(stock.result) is None
    assert not [n for n in handling_notes(stock.result) if "critical speed" in n.text]


def test_a_slippery_ground_is_warned_of(nominal: Any) -> None:
    slippery = replace(nominal.result, geometry=replace(nominal.result.geometry, friction=0.2))
    notes = handling_notes(slippery)
    assert [n.text.split(":")[0] for n in notes] == ["run1", "run2"]
    assert "friction of the vehicle file" in notes[0].text
    assert any("friction limit" in text for text in to_do(slippery, nominal.provenance))
