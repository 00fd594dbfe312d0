"""The page of a log holds its channels and loads nothing."""

from __future__ import annotations

import base64
import json
import re
from pathlib import Path

import numpy as np
from click.testing import CliRunner

from rover_sweep.cli.main import cli
from rover_sweep.data.recording import Signal
from rover_sweep.report.in_html import log_page


def channels(html: str) -> dict[str, dict[str, str]]:
    found = re.search(r'id="channels">(.*?)</script>', html, re.S)
    assert found
    return dict(json.loads(found[1]))


def test_the_page_holds_every_channel_in_degrees_since_the_start() -> None:
    t = np.arange(5.0, 9.0)
    html = log_page("<b>log", [{"r": Signal(t, np.full(4, np.pi), "rad/s"), "ay": Signal(t + 1, t, "m/s^2")}])
    found = channels(html)
    assert (found["r"]["unit"], found["ay"]["unit"]) == ("deg/s", "m/s²")
    np.testing.assert_allclose(np.frombuffer(base64.b64decode(found["r"]["x"]), "<f4"), 180.0)
    np.testing.assert_allclose(np.frombuffer(base64.b64decode(found["ay"]["t"]), "<f4"), t - 4)
    assert "<b>log" not in html and not re.search(r"(src|href)=", html.partition("<script")[0])


def test_a_log_without_channels_says_so() -> None:
    assert "holds no channel" in log_page("empty.BIN", [{}])


def test_the_command_writes_the_page(data: Path, tmp_path: Path) -> None:
    page = tmp_path / "run4.html"
    log = data / "ardurover-4.6.3" / "nominal" / "run4.BIN"
    done = CliRunner().invoke(cli, ["view", str(log), "--out", str(page)])
    assert done.exit_code == 0, done.output
    assert {"r", "ay", "p", "speed", "pwm"} <= set(channels(page.read_text(encoding="utf-8")))
