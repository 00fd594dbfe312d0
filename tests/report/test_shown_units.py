"""Accelerations in the paper's ft/s² on request: tables, charts and page agree, and SI stays the default."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from rover_sweep.report.charts.chart import Chart
from rover_sweep.report.document import Table, charts_of
from rover_sweep.report.identification.report import identification_report
from rover_sweep.report.identification.sentences import handling_table
from rover_sweep.report.identification.tables import verification_tables
from rover_sweep.report.wording import PAPER, SI

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


def test_only_accelerations_change_in_the_handling(nominal: Any) -> None:
    si, paper = (values(handling_table(nominal.result, units), 1) for units in (SI, PAPER))
    changed = {name for name in si if si[name] != paper[name]}
    assert changed == {"steady a_y/δ"} and paper["steady a_y/δ"][0] == "ft/s² per rad"
    ours, theirs = (float(v["steady a_y/δ"][1].split()[0]) for v in (si, paper))
    assert theirs == pytest.approx(FEET * ours, rel=0.01)


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
