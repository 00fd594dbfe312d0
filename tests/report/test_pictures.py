"""The charts show the data, the models with the known filters, units, and nothing else."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from rover_sweep.report.charts.chart import MODELS, Chart, Curve, Panel, Stack
from rover_sweep.report.charts.response_charts import response_chart, run_chart, verification_chart
from rover_sweep.report.document import charts_of
from rover_sweep.report.identification.report import identification_report, shown_models


def paper_charts(case: Any) -> dict[str, Chart]:
    """The charts of the paper's figures."""
    group, models = case.result.groups[0], shown_models(case.result)
    verdicts = {n: m.verification[0] for n, m in models.items() if m.verification}
    return {
        "models": response_chart(group, models),
        "responses": response_chart(group, {}),
        "verification": verification_chart(case.provenance.verify_runs[0], verdicts),
    }


@pytest.fixture(scope="module")
def charts(nominal: Any) -> dict[str, Chart]:
    return paper_charts(nominal)


def stack(chart: Chart, words: str) -> Stack:
    return next(s for s in chart.stacks if words in s.title)


def panels(chart: Chart) -> Iterator[Panel]:
    return (panel for s in chart.stacks for panel in s.panels)


def line(panel: Panel, label: str) -> Curve:
    return next(item for item in panel.lines if item.label == label)


def names_of(*case: Any) -> list[str]:
    return [plan.name for plan in charts_of(identification_report(*case).sections)]


def test_there_is_one_for_each_run_the_models_their_errors_and_the_verification(nominal: Any) -> None:
    names = names_of(nominal.result, nominal.provenance)
    assert names == ["models", "errors", "verification-run4", "history-run1", "history-run2", "history-run4"]


def test_model_lines_are_the_models_with_the_sensors_filters(charts: dict[str, Chart], nominal: Any) -> None:
    group = nominal.result.groups[0]
    magnitude = stack(charts["models"], "yaw rate r").panels[0]
    w = group.responses["r"].w
    for name in ("bicycle", "roll-yaw", "lumped"):
        structure = nominal.result.models[name].fit.structure
        h = structure.response(w, group.speed, "r", group.runs[0].filters)
        np.testing.assert_allclose(line(magnitude, f"{name} model").y, 20 * np.log10(np.abs(h)))
    np.testing.assert_allclose(line(magnitude, "measured").y, group.responses["r"].magnitude_db)
    roll = stack(charts["models"], "roll rate p").panels[0]
    assert "bicycle model" not in [item.label for item in roll.lines]


def test_phase_of_the_models_lies_beside_that_of_the_data(charts: dict[str, Chart]) -> None:
    phases = [p for p in panels(charts["models"]) if p.label == "phase, deg"]
    assert phases
    for panel in phases:
        measured, *models = panel.lines
        assert models and all(abs(np.median(m.y - measured.y)) < 60 for m in models)


def test_frequency_axes_are_logarithmic_in_rad_per_s_and_mark_the_usable_band(
    charts: dict[str, Chart], nominal: Any
) -> None:
    stacks = charts["responses"].stacks
    assert len(stacks) == 4 and len(list(panels(charts["responses"]))) == 12
    assert all(s.kind == "log" and s.x_label == "frequency, rad/s" for s in stacks)
    edges = [x for x, _ in stack(charts["responses"], "lateral velocity rate").marks]
    assert edges == pytest.approx(nominal.result.groups[0].responses["vydot"].band)


def test_verification_shows_the_overlays_with_j_rms_and_tic(charts: dict[str, Chart], nominal: Any) -> None:
    (shown,) = charts["verification"].stacks
    verdict = nominal.result.models["roll-yaw"].verification[0]
    assert f"roll-yaw: J_rms {verdict.j_rms:.2f}, TIC {verdict.tic:.3f}" in shown.title
    for overlay, panel in zip(verdict.overlays, shown.panels[1:], strict=True):
        factor = 0.3048 if overlay.unit.startswith("ft") else 1.0
        assert ("m/s²" if factor < 1 else "deg/s") in panel.label
        np.testing.assert_allclose(line(panel, "roll-yaw").y, factor * overlay.model)
        np.testing.assert_allclose(line(panel, "measured").y, factor * overlay.measured)


def test_time_history_is_in_degrees_and_begins_with_the_manoeuvre(nominal: Any) -> None:
    run = nominal.result.groups[0].runs[0]
    (shown,) = run_chart(run).stacks
    assert [p.label.split(", ")[-1] for p in shown.panels] == ["µs", "deg", "deg/s", "m/s²", "deg/s", "m/s"]
    rate = shown.panels[2]
    inside = (rate.x >= 0) & (rate.x <= run.span[1] - run.span[0])
    np.testing.assert_allclose(rate.lines[0].y[inside], np.degrees(run.manoeuvre("r").x))


def test_models_differ_in_colour_and_in_dashes() -> None:
    assert len({s["colour"] for s in MODELS.values()}) == len(MODELS)
    assert len({s.get("dash") for s in MODELS.values()}) == len(MODELS)


def test_a_rejected_model_is_not_drawn(stock: Any) -> None:
    labels = {item.label for panel in panels(paper_charts(stock)["models"]) for item in panel.lines}
    assert "kinematic model" in labels and "bicycle model" not in labels


def test_a_response_without_a_band_is_drawn_with_its_phase_within_half_a_turn(stock: Any) -> None:
    shown = stack(paper_charts(stock)["responses"], "roll rate p")
    assert "no usable band" in shown.title
    assert np.max(np.abs(shown.panels[1].lines[0].y)) <= 180


def test_runs_of_the_same_name_get_pictures_of_different_names(nominal: Any) -> None:
    again = replace(nominal.provenance, verify_runs=nominal.result.groups[0].runs)
    names = names_of(nominal.result, again)
    assert len(set(names)) == len(names) and "history-run1-2" in names
