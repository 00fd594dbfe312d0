"""The interactive charts hold the result's numbers, and their script runs."""

from __future__ import annotations

import base64
import json
import re
import shutil
import subprocess
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from rover_sweep.report.charts.chart import Chart, Curve, Panel, Spread, Stack, kept_points, ticks
from rover_sweep.report.charts.response_charts import response_chart, run_chart, verification_chart
from rover_sweep.report.charts.static_svg import chart_json, page_script, svg
from rover_sweep.report.document import charts_of
from rover_sweep.report.identification.report import identification_report, shown_models


def values(text: str) -> np.ndarray:
    return np.frombuffer(base64.b64decode(text), dtype="<f4")


@pytest.fixture(scope="module")
def charts(reports: dict[str, Path]) -> list[dict[str, Any]]:
    html = (reports["nominal"] / "report.html").read_text(encoding="utf-8")
    return [json.loads(t) for t in re.findall(r'<script type="application/json">(.*?)</script>', html, re.S)]


def named(panel: dict[str, Any], label: str) -> np.ndarray:
    return values(next(line["y"] for line in panel["lines"] if line["label"] == label))


def test_responses_of_the_page_are_those_of_the_result(charts: list[dict[str, Any]], nominal: Any) -> None:
    group = nominal.result.groups[0]
    stack = charts[0]["stacks"][0]
    magnitude, _, coherence = stack["panels"]
    f = group.responses["r"]
    np.testing.assert_allclose(values(magnitude["x"]), f.w, rtol=1e-6)
    np.testing.assert_allclose(named(magnitude, "measured"), f.magnitude_db, rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(named(coherence, "coherence"), f.coherence, rtol=1e-5)
    structure = nominal.result.models["roll-yaw"].fit.structure
    h = structure.response(f.w, group.speed, "r", group.runs[0].filters)
    np.testing.assert_allclose(
        named(magnitude, "roll-yaw model"), 20 * np.log10(np.abs(h)), rtol=1e-5, atol=1e-5
    )
    low = values(magnitude["spreads"][0]["low"])
    np.testing.assert_allclose(low, f.magnitude_db + 20 * np.log10(1 - 2 * f.random_error), atol=1e-4)


def test_thinning_keeps_every_peak_and_the_ends() -> None:
    y = np.zeros(100_000)
    y[[12_345, 77_777]] = 5.0, -7.0
    kept = kept_points([y], 2000)
    assert kept.size < 2100 and {0, 12_345, 77_777, 99_999} <= set(kept.tolist())
    assert kept_points([y[:50]], 2000).size == 50


def chart(label: str = "y") -> Chart:
    x = np.array([1.0, 2.0, 4.0])
    y = np.array([0.5, np.nan, 2.0])
    panel = Panel(
        "y, m", x, (Curve(label, y, "#000000"), Curve("b", x, "#123456", dots=True)), (Spread("s", x, 2 * x),)
    )
    return Chart((Stack("a title", "x, s", (panel,), (1.0, 4.0), "log", ((1.0, 2.0, "#eeeeee"),)),))


def test_svg_is_well_formed_whatever_the_names() -> None:
    text = svg(chart("<script>&\x07</script>"))
    assert ElementTree.fromstring(text).tag.endswith("svg")
    assert "<script" not in text


def test_json_cannot_end_its_script_element() -> None:
    text = chart_json(chart("</script><b>&"))
    assert "<" not in text and json.loads(text)["stacks"][0]["panels"][0]["lines"][0]["label"].startswith(
        "</"
    )


def test_ticks_are_round_and_inside() -> None:
    assert [label for _, label in ticks(0.0, 1.0, most=5)] == ["0", "0.2", "0.4", "0.6", "0.8", "1"]
    assert [label for _, label in ticks(0.3, 25.0, "log")] == ["0.5", "1", "2", "5", "10", "20"]
    assert [label for _, label in ticks(0.0, 3 * 86400.0, "date")][:2] == ["01 Jan", "02 Jan"]


@pytest.mark.skipif(not shutil.which("node"), reason="needs node")
def test_the_script_runs_and_unpacks_the_numbers(tmp_path: Path) -> None:
    data = json.loads(chart_json(chart()))["stacks"][0]["panels"][0]
    script = tmp_path / "page.js"
    packed = json.dumps(data["lines"][0]["y"])
    ask = f"console.log(JSON.stringify([sweepCharts.numbers({packed}, 4), sweepCharts.decades(0.3, 25)]))"
    stubs = "globalThis.devicePixelRatio = 1; globalThis.navigator ??= {language: 'en'};"
    script.write_text(f"{stubs}\n{page_script()}\n{ask}", encoding="utf-8")
    done = subprocess.run(["node", str(script)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-500:]
    assert json.loads(done.stdout) == [[0.5, None, 2], [0.5, 1, 2, 5, 10, 20]]


# ---- The charts show the data, the models with the known filters, units, and nothing else.


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
def drawn(nominal: Any) -> dict[str, Chart]:
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
    again = replace(nominal.provenance, verify_runs=nominal.result.groups[0].runs)
    names = names_of(nominal.result, again)  # of runs of the same name
    assert len(set(names)) == len(names) and "history-run1-2" in names


def test_frequency_axes_are_logarithmic_in_rad_per_s_and_mark_the_usable_band(
    drawn: dict[str, Chart], nominal: Any
) -> None:
    stacks = drawn["responses"].stacks
    assert len(stacks) == 4 and len(list(panels(drawn["responses"]))) == 12
    assert all(s.kind == "log" and s.x_label == "frequency, rad/s" for s in stacks)
    edges = [x for x, _ in stack(drawn["responses"], "lateral velocity rate").marks]
    assert edges == pytest.approx(nominal.result.groups[0].responses["vydot"].band)


def test_verification_shows_the_overlays_with_j_rms_and_tic(drawn: dict[str, Chart], nominal: Any) -> None:
    (shown,) = drawn["verification"].stacks
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


def test_a_rejected_model_is_not_drawn_and_a_phase_without_a_band_is_within_half_a_turn(stock: Any) -> None:
    drawn = paper_charts(stock)
    labels = {item.label for panel in panels(drawn["models"]) for item in panel.lines}
    assert "kinematic model" in labels and "bicycle model" not in labels
    shown = stack(drawn["responses"], "roll rate p")
    assert "no usable band" in shown.title
    assert np.max(np.abs(shown.panels[1].lines[0].y)) <= 180
