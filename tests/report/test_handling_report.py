"""Handling in the report: the same numbers in the document, the table and the page; warnings where due."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import pytest

from rover_sweep.report.identification.handling_table import handling_notes, handling_table
from rover_sweep.report.identification.identification_json import identification_document
from rover_sweep.report.identification.remarks import to_do
from rover_sweep.report.wording.strict_json import strict_json


def test_document_and_table_hold_the_quantities(nominal: Any, reports: Any) -> None:
    document = json.loads(strict_json(identification_document(*nominal)))["handling"]
    found = nominal.result.handling["roll-yaw"]
    told = document["models"]["roll-yaw"]
    assert told["quantities"]["yaw_frequency"]["value"] == found["yaw_frequency"].value
    assert told["quantities"]["understeer_gradient_deg_per_g"]["unit"] == "deg/g"
    assert set(document["models"]) == {
        f"{m}{v}" for m in ("bicycle", "roll-yaw") for v in ("", ", Cf and Cr free")
    }
    table = handling_table(nominal.result)
    assert table and table.headings[2:] == ("Bicycle", "Roll-yaw")
    assert any(row[0].text == "roll mode, frequency" and row[2].text == "–" for row in table.rows)
    assert "Handling at 2.45 m/s" in (reports["nominal"] / "report.html").read_text()
    assert document["notes"] == []


def test_the_recorded_rover_is_nearly_neutral(nominal: Any) -> None:
    """Its tyres of 31.0 and 33.5 N/rad at .203 and .188 m make K_us 2e-3 deg/g; b - a alone says -1.9."""
    k = nominal.result.handling["roll-yaw, Cf and Cr free"]["understeer_gradient_deg_per_g"]
    assert abs(k.value - 0.002) < k.bound < 2
    assert nominal.result.handling["roll-yaw"]["understeer_gradient_deg_per_g"].value == pytest.approx(
        -1.8, abs=0.2
    )


def test_tyres_that_cannot_be_identified_have_no_handling(stock: Any) -> None:
    assert stock.result.handling == {} and handling_table(stock.result) is None
    assert not [n for n in handling_notes(stock.result) if "critical speed" in n.text]


def test_a_slippery_ground_is_warned_of(nominal: Any) -> None:
    slippery = replace(nominal.result, geometry=replace(nominal.result.geometry, friction=0.2))
    notes = handling_notes(slippery)
    assert [n.text.split(":")[0] for n in notes] == ["run1", "run2"]
    assert "friction of the vehicle file" in notes[0].text
    assert any("friction limit" in text for text in to_do(slippery, nominal.provenance))
