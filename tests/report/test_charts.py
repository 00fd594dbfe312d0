"""The interactive charts hold the result's numbers, and their script runs."""

from __future__ import annotations

import base64
import json
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from rover_sweep.report.charts.chart import (
    CHANNEL_WORDS,
    Chart,
    Curve,
    Panel,
    Spread,
    Stack,
    kept_points,
    ticks,
)
from rover_sweep.report.charts.static_svg import chart_json, page_script, page_styles, svg
from rover_sweep.report.document import charts_of
from rover_sweep.report.identification.report import identification_report


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


def test_error_of_a_model_is_its_relative_difference(charts: list[dict[str, Any]], nominal: Any) -> None:
    group = nominal.result.groups[0]
    f = group.responses["p"]
    panel = next(s for s in charts[1]["stacks"] if s["title"].startswith("roll rate"))["panels"][0]
    w = values(panel["x"])
    h = nominal.result.models["roll-yaw"].fit.structure.response(f.w, group.speed, "p", group.runs[0].filters)
    wanted = np.interp(w, f.w, 100 * np.abs(h / f.h - 1))
    np.testing.assert_allclose(named(panel, "roll-yaw model"), wanted, rtol=1e-3, atol=1e-3)


def test_verification_is_in_si_units(charts: list[dict[str, Any]], nominal: Any) -> None:
    overlay = next(o for o in nominal.result.models["roll-yaw"].verification[0].overlays if o.channel == "ay")
    panel = next(p for p in charts[2]["stacks"][0]["panels"] if "m/s²" in p["label"])
    measured = named(panel, "measured")
    assert measured.max() == pytest.approx(0.3048 * overlay.measured.max(), rel=1e-5)
    assert measured.min() == pytest.approx(0.3048 * overlay.measured.min(), rel=1e-5)


def test_a_report_stays_below_two_megabytes(reports: dict[str, Path]) -> None:
    assert (reports["nominal"] / "report.html").stat().st_size < 2e6


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


def test_long_titles_side_by_side_are_broken_into_lines() -> None:
    long = replace(chart().stacks[0], title=f"{'much ' * 14}of it; J {'roll-yaw 1.3, ' * 3}")
    drawn = ElementTree.fromstring(svg(Chart((long, chart().stacks[0]), columns=2)))
    titles = [e.text or "" for e in drawn.iter() if e.get("font-weight") == "600"]
    assert len(titles) == 4 and all(len(t) <= 62 for t in titles)
    assert titles[2].startswith("J roll-yaw") and titles[3] == "a title"


def test_json_cannot_end_its_script_element() -> None:
    text = chart_json(chart("</script><b>&"))
    assert "<" not in text and json.loads(text)["stacks"][0]["panels"][0]["lines"][0]["label"].startswith(
        "</"
    )


def test_ticks_are_round_and_inside() -> None:
    assert [label for _, label in ticks(0.0, 1.0, most=5)] == ["0", "0.2", "0.4", "0.6", "0.8", "1"]
    assert [label for _, label in ticks(0.3, 25.0, "log")] == ["0.5", "1", "2", "5", "10", "20"]
    assert [label for _, label in ticks(0.0, 3 * 86400.0, "date")][:2] == ["01 Jan", "02 Jan"]


def test_every_chart_of_a_result_has_a_panel(nominal: Any) -> None:
    for plan in charts_of(identification_report(*nominal).sections):
        assert all(p.x.size and p.lines for s in plan.make().stacks for p in s.panels)


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


def test_every_panel_has_its_own_x_labels_and_room_for_its_name() -> None:
    stack = chart().stacks[0]
    text = svg(Chart((replace(stack, panels=stack.panels * 3),)))
    assert text.count('text-anchor="middle" fill="#555555" font-size="11">2</text>') == 3
    assert "last ? v.map" not in page_script()
    assert all(6.3 * len(CHANNEL_WORDS[c]) < Panel.height for c in ("vy", "vydot"))


def test_a_legend_without_values_has_no_colons() -> None:
    assert ".chart .u-legend.u-live th::after { content: none; }" in page_styles()
