"""The page of throttle sweeps: its answer, its charts, and the limits of steering runs in the same folder."""

from __future__ import annotations

import base64
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rover_sweep as rs
from rover_sweep.api.speed import SpeedIdentification
from rover_sweep.cli.main import run

DATA = Path(__file__).parents[1] / "data"
SWEEP = DATA / "ardurover-4.6.3" / "throttle" / "sweep.BIN"


@pytest.fixture(scope="module")
def speed() -> SpeedIdentification:
    return rs.identify_speed(SWEEP)


def charts(html: str) -> list[dict[str, Any]]:
    return [
        json.loads(text) for text in re.findall(r'<script type="application/json">(.*?)</script>', html, re.S)
    ]


def numbers(text: str) -> np.ndarray:
    return np.frombuffer(base64.b64decode(text), "<f4")


def test_the_answer_comes_first_and_every_setting_is_in_it(
    speed: SpeedIdentification, tmp_path: Path
) -> None:
    html = speed.report(tmp_path).page.read_text()
    first = html.partition('<section class="first" id="answer">')[2].partition("</section>")[0]
    for name in (
        "gain",
        "lag",
        "delay",
        "drag",
        "dead zone",
        "CRUISE_SPEED",
        "CRUISE_THROTTLE",
        "ATC_SPEED_P",
    ):
        assert f">{name}<" in first, name
    assert "ATC_ACCEL_MAX" in first and "margins at least" in first and "overshoot" in first
    assert html.index("worst phase margin, deg") < html.index('id="runs"')
    assert "ATC_TURN_MAX_G need steering sweeps" in first
    assert html.count('<div class="static"><div role="img"') == 3, "each chart has a static form"


def test_the_charts_hold_the_drive_the_response_and_the_step(
    speed: SpeedIdentification, tmp_path: Path
) -> None:
    step, history, bode = charts(speed.report(tmp_path).page.read_text())
    at, lines = (history["stacks"][0]["panels"][1][key] for key in ("x", "lines"))
    x, measured, law = numbers(at), numbers(lines[0]["y"]), numbers(lines[1]["y"])
    within = (x > 1) & (x < 71)
    assert np.sqrt(np.mean((measured - law)[within] ** 2)) < 0.05
    assert np.isnan(law[x > 73]).all() and not np.isnan(measured).any(), "the law ends with the sweep"
    assert [p["label"] for p in bode["stacks"][0]["panels"]] == ["magnitude, dB", "phase, deg", "coherence"]
    magnitude = numbers(bode["stacks"][0]["panels"][0]["lines"][1]["y"])
    assert magnitude[0] == pytest.approx(20 * np.log10(speed.parameters["gain"].value), abs=0.2)
    drawn = {line["label"]: numbers(line["y"]) for line in step["stacks"][0]["panels"][0]["lines"]}
    assert drawn.keys() == {"commanded", "now", "proposed"}
    assert drawn["proposed"][-1] == pytest.approx(drawn["commanded"][-1], abs=0.03)


def test_steering_runs_in_the_same_folder_add_their_limits(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    steered = [str(DATA / "ardurover-4.6.3" / "nominal" / f"run{n}.BIN") for n in (1, 4)]  # and a doublet
    given = [*steered, str(SWEEP), "--vehicle", str(DATA / "rover.toml"), "--models", "bicycle"]
    assert run(["identify", *given, "--bootstrap", "0", "--out", str(tmp_path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["format"] == "rover-sweep identification"
    html = (tmp_path / "speed.html").read_text()
    assert ">ATC_STR_RAT_MAX<" in html and ">ATC_TURN_MAX_G<" in html
    assert 'href="report.html"' in html and 'href="speed.html"' in (tmp_path / "report.html").read_text()


def test_without_a_law_the_page_says_why(speed: SpeedIdentification, tmp_path: Path) -> None:
    from dataclasses import replace

    none = replace(speed, level="none", reasons=("no excitation",), fit=None, coherence=None, coasting=None)
    html = none.report(tmp_path).page.read_text()
    assert "was not identified" in html and "No excitation." in html
    assert len(charts(html)) == 1 and not none.parameters
    with pytest.raises(rs.UsageError, match="no excitation"):
        none.to_frame()
