"""A recording driven again on vehicles with an autopilot: the embedded rover, the real firmware."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rover_sweep.cli.main import run
from rover_sweep.logs.read import read_runs
from sitl.launcher import LaunchError, find_ardurover


def agrees(source: Path, again: Path, share: float = 0.09) -> None:
    """Same clock, steering and speed; the yaw rate within noise and what two scripts differ by."""
    (field,), (simulated,) = read_runs(str(source)), read_runs(str(again))
    assert simulated.kind == field.kind
    assert simulated.span == pytest.approx(field.span, abs=0.05)
    t = np.arange(field.span[0], field.span[1], 0.01)
    smooth = np.ones(10) / 10
    pwm = [np.convolve(one["pwm"].on(t), smooth, "same") for one in (field, simulated)]
    assert np.std(pwm[0] - pwm[1]) < 0.05 * np.std(pwm[0])
    assert abs(simulated.mean_speed - field.mean_speed) < 0.02
    difference = field["r"].on(t) - simulated["r"].on(t)
    assert np.std(difference) < share * np.std(field["r"].on(t))


@pytest.mark.parametrize(("name", "share"), [("applet/run2.BIN", 0.09), ("defaults/run1.BIN", 0.12)])
def test_embedded(data: Path, truth: Path, tmp_path: Path, name: str, share: float) -> None:
    """With the applet's rows; with RCOU alone, which has 25 rad/s at 10 Hz."""
    source, out = data / "ardurover-4.6.3" / name, tmp_path / "again.BIN"
    options = ("--variant", str(truth), "--simulator", "embedded", "--out", str(out))
    assert run(["redrive", str(source), *options]) == 0
    agrees(source, out, share)


@pytest.mark.ardurover
def test_real_firmware(data: Path, truth: Path, tmp_path: Path) -> None:
    try:
        find_ardurover()
    except LaunchError as error:
        pytest.skip(str(error))
    source, out = data / "ardurover-4.6.3" / "applet" / "run2.BIN", tmp_path / "again.BIN"
    options = ("--variant", str(truth), "--simulator", "ardurover", "--out", str(out))
    assert run(["redrive", str(source), *options]) == 0
    agrees(source, out)
    assert out.stat().st_size < 3 * source.stat().st_size
