"""Tables and sentences of the report."""

from __future__ import annotations

import io
import re
from dataclasses import replace
from typing import Any

import pytest
from rich.console import Console

from rover_sweep.data.results import number
from rover_sweep.report.document import Table
from rover_sweep.report.identification.report import identification_report
from rover_sweep.report.identification.sentences import diagnosis_remark, filters_known, filters_remark, to_do
from rover_sweep.report.identification.tables import (
    coherence_table,
    cost_table,
    filters_table,
    inertia_table,
    main_table,
    parameter_table,
    reduction_table,
    variants_table,
    verification_tables,
)
from rover_sweep.report.on_terminal import on_terminal
from rover_sweep.report.wording import band, change, percent, symbol


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


def test_bounds_beyond_the_guidelines_are_marked(nominal: Any) -> None:
    free = {e.name: e for e in nominal.result.models["lumped"].fit.estimates if e.free}
    weak = {symbol(n) for n, e in free.items() if (e.cr_percent or 0) > 20}
    marked = {r[0].text for r in parameter_table(nominal.result, "lumped").rows if r[5].tone == "warn"}
    assert marked == weak and weak


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


def test_runs_have_their_speed(nominal: Any) -> None:
    table = coherence_table(nominal.result)
    column = table.headings.index("m/s")
    first = nominal.result.groups[0].runs[0]
    assert table.rows[0][column].text == number(first.mean_speed, 3)


def test_inertia_is_compared_with_the_vehicle_file_in_percent(nominal: Any) -> None:
    table = rows(inertia_table(nominal.result, nominal.provenance))
    found = nominal.result.models["roll-yaw"].fit["Izz"].value
    assert table["vehicle file"][:2] == ["0.06900", "± 0.0030"]
    assert table["Roll-yaw model"][2] == change(100 * (found / 0.069 - 1))
    assert inertia_table(nominal.result, replace(nominal.provenance, vehicle=None)) is None


def test_reduction_names_every_step(nominal: Any) -> None:
    model = nominal.result.models["lumped"]
    table = reduction_table(model)
    assert table is not None and len(table.rows) == len(model.reduction)
    assert not reduction_table(nominal.result.models["bicycle"]).rows


def test_other_fits_stand_side_by_side(nominal: Any) -> None:
    table = variants_table(nominal.result, "roll-yaw")
    assert table is not None and table.headings[1] == "the fit"
    assert {"filters ignored", "four responses", "one C for both axles"} <= set(table.headings)
    tied = nominal.result.models["roll-yaw"].variants["one C for both axles"]
    column = table.headings.index("one C for both axles") - 1
    assert rows(table)["Cf = Cr, N/rad"][column] == number(tied["C"].value)
    assert rows(table)["Cf, N/rad"][column] == "–"


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


def test_ignored_20_hz_filters_only_move_the_delay(nominal: Any) -> None:
    remark = filters_remark(nominal.result)
    assert remark is not None and "has the same cost" in remark and "is wrong" not in remark


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


def terminal(case: Any, width: int, full: bool = False) -> str:
    out = io.StringIO()
    console = Console(file=out, width=width, force_terminal=False)
    console.print(on_terminal(identification_report(*case), full, answer_last=True))
    return out.getvalue()


@pytest.mark.parametrize("width", [80, 100])
def test_the_terminal_shows_all_tables_within_its_width(nominal: Any, width: int) -> None:
    text = terminal(nominal, width, full=True)
    for words in (
        "Runs",
        "Bicycle model",
        "Roll-yaw model",
        "Lumped model",
        "Model structure reduction",
        "Cost J",
        "Verification on run4",
        "Yaw inertia",
        "Effect of the sensors' filters",
    ):
        assert words in text
    assert max(len(row) for row in text.splitlines()) <= width
    assert "…" not in text and not re.search(r"^\s*%", text, re.MULTILINE)
    assert "Use the roll-yaw model" in text


def test_the_terminal_is_short_unless_asked(nominal: Any) -> None:
    text = terminal(nominal, 80)
    assert "Bicycle model" not in text and "If the sensors' filters" not in text
    assert len(text.splitlines()) < 36
    assert "Roll-yaw model" in text and "Use the roll-yaw model" in text
    verdict = nominal.result.models["roll-yaw"].verification[0]
    grades = f"J_rms {number(verdict.j_rms, 3)} and TIC {number(verdict.tic, 2)}"
    assert f"On run4 (not in the fit) {grades}" in " ".join(text.split())
    whole = terminal(nominal, 80, full=True)
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
