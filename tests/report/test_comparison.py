"""Tables and sentences of the report."""

from __future__ import annotations

import io
import json
import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from rover_sweep.data.results import number
from rover_sweep.report.charts.chart import Chart
from rover_sweep.report.document import Table, charts_of
from rover_sweep.report.identification.identification_json import identification_document
from rover_sweep.report.identification.report import identification_report
from rover_sweep.report.identification.sentences import (
    diagnosis_remark,
    filters_known,
    filters_remark,
    handling_notes,
    handling_table,
    to_do,
)
from rover_sweep.report.identification.tables import (
    cost_table,
    filters_table,
    main_table,
    parameter_table,
    variants_table,
    verification_tables,
)
from rover_sweep.report.on_terminal import on_terminal
from rover_sweep.report.wording import PAPER, SI, band, change, percent, strict_json, symbol


def rows(table: Table | None) -> dict[str, list[str]]:
    """Texts of each row by its first cell."""
    assert table is not None
    return {row[0].text: [cell.text for cell in row[1:]] for row in table.rows}


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0711937, "0.07119"),
        (31.0, "31.00"),
        (0, "0"),
        (126.41, "126.4"),
        (-748.077, "-748.1"),
        (1e-7, "1.000e-07"),
        (2.5e6, "2.500e+06"),
        (None, "–"),
        (float("inf"), "–"),
    ],
)
def test_numbers_have_four_significant_digits(value: float | None, text: str) -> None:
    assert number(value) == text


def test_percentages_changes_bands_and_symbols() -> None:
    assert (percent(8.234), percent(2390.0), percent(None)) == ("8.23", "> 1000", "–")
    assert (change(-7.84), change(-0.004), change(None)) == ("-7.8", "+0.0", "–")
    assert (band((0.294, 23.19)), band(None)) == ("0.29–23.2", "–")
    assert (symbol("C"), symbol("L_phi"), symbol("Y_delta"), symbol("h")) == ("Cf = Cr", "L_φ", "Y_δ", "h")


def test_parameter_table_is_the_paper_s_table_3(nominal: Any) -> None:
    table = rows(parameter_table(nominal.result, "roll-yaw"))
    e = nominal.result.models["roll-yaw"].fit["Cf"]
    assert table[symbol("Cf")] == [
        "cornering stiffness, front axle",
        number(e.value),
        "N/rad",
        "free",
        percent(e.cr_percent),
        percent(e.insensitivity_percent),
    ]
    assert table["m_s"] == ["sprung mass", "2.400", "kg", "fixed", "–", "–"]
    assert table["V_x"][1] == number(nominal.result.speed)


def test_cost_table_puts_what_was_not_fitted_in_brackets(nominal: Any) -> None:
    models = nominal.result.models
    table = cost_table(nominal.result)
    assert table.headings == ("response", "Kinematic", "Bicycle", "Roll-yaw", "Lumped")
    vydot = rows(table)["lateral velocity rate vydot / δ"]
    assert vydot[0] == "n/a" and vydot[2] == f"({models['roll-yaw'].costs['vydot']:.1f})"
    assert rows(table)["J_ave, fitted"][2] == f"{models['roll-yaw'].fit.average:.1f}"
    assert rows(table)["J_ave, all responses"][2] == f"{models['roll-yaw'].average_all:.1f}"


def test_verification_table_has_a_column_for_each_model(nominal: Any) -> None:
    (table,) = verification_tables(nominal.result)
    assert "run4" in table.title
    verdict = nominal.result.models["lumped"].verification[0]
    assert rows(table)["J_rms"][3] == number(verdict.j_rms, 3)
    assert rows(table)["TIC"][3] == number(verdict.tic, 3)
    assert rows(table)["J_rms of p, deg/s"][1] == "n/a"
    yaw = next(o for o in verdict.overlays if o.channel == "r")
    assert rows(table)["J_rms of r, deg/s"][3] == number(yaw.j_rms, 3)
    assert rows(table)["TIC of r"][3] == number(yaw.tic, 2)


def test_ignored_4_hz_filters_are_shown_to_look_fine_and_to_be_wrong(defaults: Any) -> None:
    model = defaults.result.models["roll-yaw"]
    other = model.variants["filters ignored"]
    remark = filters_remark(defaults.result)
    assert remark is not None
    assert "has a good cost" in remark and "is wrong" in remark
    assert f"J_ave {other.average:.1f} without them, {model.fit.average:.1f} with them" in remark
    moved = 100 * (other["Izz"].value / model.fit["Izz"].value - 1)
    assert moved > 30 and f"I_zz by {moved:+.0f} %" in remark
    assert "4.00 Hz (INS_GYRO_FILTER)" in filters_known(defaults.result)
    table = filters_table(defaults.result)
    assert table is not None
    izz = next(r for r in table.rows[3:] if r[1].text == "I_zz, kg m²")
    assert [izz[2].text, izz[3].text] == [number(model.fit["Izz"].value), number(other["Izz"].value)]
    assert izz[4].tone == "warn"


def test_a_kinematic_rover_shows_no_tyre_number_anywhere(stock: Any) -> None:
    table = parameter_table(stock.result, "bicycle")
    assert rows(table)["Cf = Cr"][1] == "not identifiable"
    assert "kinematic model fits as well" in table.note
    assert variants_table(stock.result, "bicycle") is None
    assert {r[0].text for r in filters_table(stock.result).rows} <= {"Kinematic", ""}  # type: ignore[union-attr]
    assert "L_eff" in rows(main_table(stock.result)) and "Cf" not in rows(main_table(stock.result))


def test_what_to_do_first_names_runs_to_repeat_refusals_and_missing_verification(
    nominal: Any, stock: Any, defaults: Any
) -> None:
    assert to_do(nominal.result, replace(nominal.provenance, verify_runs=())) == to_do(*nominal) + (
        "there is no run for verification: drive a doublet and give it with --verify",
    )
    sentence = "repeat with 4.0 times the amplitude"
    poor = replace(nominal.result.coherence[0], advice="repeat", sentence=sentence)
    told = to_do(replace(nominal.result, coherence=(poor,)), nominal.provenance)
    assert told[0] == f"run1: {sentence}"
    assert any("roll rate does not follow" in text for text in to_do(*stock))
    why = "the lumped model needs roll_inertia in the vehicle file"  # a text without a colon
    assert why in to_do(replace(nominal.result, refused={"lumped": why}), nominal.provenance)


def terminal(case: Any, width: int, full: bool = False) -> str:
    out = io.StringIO()
    console = Console(file=out, width=width, force_terminal=False)
    console.print(on_terminal(identification_report(*case), full, answer_last=True))
    return out.getvalue()


@pytest.mark.parametrize("width", [80, 100])
def test_the_terminal_is_short_unless_asked_and_keeps_its_width(nominal: Any, width: int) -> None:
    brief, whole = (terminal(nominal, width, full) for full in (False, True))
    for words in ("Bicycle model", "Model structure reduction", "Cost J", "Effect of the sensors' filters"):
        assert words in whole and words not in brief
    assert "Verification on run4" in whole and "Yaw inertia" in whole
    assert max(len(row) for row in whole.splitlines()) <= width and len(brief.splitlines()) < 36
    assert "…" not in whole and not re.search(r"^\s*%", whole, re.MULTILINE)
    assert "Roll-yaw model" in brief and "Use the roll-yaw model" in brief
    verdict = nominal.result.models["roll-yaw"].verification[0]
    grades = f"J_rms {number(verdict.j_rms, 3)} and TIC {number(verdict.tic, 2)}"
    assert f"On run4 (not in the fit) {grades}" in " ".join(brief.split())
    assert "ignores the sensors' low-pass filters has the same cost" in " ".join(whole.split())


def test_a_diagnosis_is_proposed_where_a_response_is_missed_and_only_there(nominal: Any) -> None:
    result = nominal.result
    assert diagnosis_remark(result) is None
    model = result.models["roll-yaw"]
    missed = replace(model, fit=replace(model.fit, costs={"r": 20.0, "ay": 130.0, "p": 30.0}))
    poor = replace(result, models={**result.models, "roll-yaw": missed})
    assert diagnosis_remark(poor) == (
        "J of a_y is 130: use `rover-sweep diagnose` with the same runs to find what the roll-yaw model "
        "leaves out."
    )
    assert "rover-sweep diagnose" in terminal((poor, nominal.provenance), 100)


# ---- Handling in the report: the same numbers in the document, the table and the page; warnings where due.


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


# ---- Accelerations in the paper's ft/s² on request: tables, charts and page agree, and SI stays the default.

FEET = 3.28084  # in 1 m


def values(table: Table | None, column: int) -> Mapping[str, tuple[str, ...]]:
    assert table is not None
    return {row[0].text: tuple(cell.text for cell in row[column:]) for row in table.rows}


def test_verification_of_a_y_is_in_feet(nominal: Any) -> None:
    si, paper = (values(verification_tables(nominal.result, *units)[0], 1) for units in ((), (PAPER,)))
    ours, theirs = (float(v["J_rms of a_y, " + u][1]) for v, u in ((si, "m/s²"), (paper, "ft/s²")))
    assert theirs == pytest.approx(FEET * ours, rel=0.01)
    for name in ("J_rms", "TIC", "J_rms of r, deg/s"):
        assert si[name] == paper[name]


def test_charts_are_scaled_with_their_labels(nominal: Any) -> None:
    si, paper = (
        {plan.name: plan.make() for plan in charts_of(identification_report(*nominal, units).sections)}
        for units in (SI, PAPER)
    )

    def panel(chart: Chart, word: str) -> Any:
        return next(p for s in chart.stacks for p in s.panels if word in p.label)

    for name in ("history-run4", "verification-run4"):
        ours, theirs = panel(si[name], "m/s²"), panel(paper[name], "ft/s²")
        for a, b in zip(ours.lines, theirs.lines, strict=True):
            np.testing.assert_allclose(b.y, FEET * a.y, rtol=1e-5)
    ours, theirs = (next(s for s in c["models"].stacks if "a_y" in s.title) for c in (si, paper))
    assert "ft/s² per rad" in theirs.title and "m/s² per rad" in ours.title
    for a, b in zip(ours.panels[0].lines, theirs.panels[0].lines, strict=True):
        np.testing.assert_allclose(b.y - a.y, 20 * np.log10(FEET), atol=1e-4)
    np.testing.assert_array_equal(ours.panels[1].lines[0].y, theirs.panels[1].lines[0].y)
