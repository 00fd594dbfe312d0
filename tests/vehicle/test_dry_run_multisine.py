"""A multisine and a sweep about a bias on the embedded rover: driven, recognised, and what they show."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rover_sweep.data.recording import Recording
from rover_sweep.logs.read import read_runs
from rover_sweep.manoeuvre.multisine import Multisine
from rover_sweep.manoeuvre.sweep import BiasSweep, Doublet
from rover_sweep.spectra.harmonics import Harmonics, harmonics
from rover_sweep.vehicle.events import LogSaved, RunFinished
from tests.vehicle.simulated_drive import drive_simulated

MULTISINE = Multisine(amplitude=250, w_min=0.6, w_max=16, t_rec=24, periods=2)
BIAS_SWEEP = BiasSweep(amplitude=80, bias=120, w_min=2, w_max=16, t_rec=8, straight=1)
ASYMMETRIC = "steering_asymmetry = { e = 0.15 }"
CUBIC = "steering_nonlinearity = { c3 = -4.0 }"


def driven(folder: Path, effects: str, bias_sweep: BiasSweep | None = None) -> tuple[Recording, ...]:
    """The runs in the log of a rover with these effects, each of which came to its end."""
    variant = folder / "variant.toml"
    variant.write_text(f'base = "nominal"\n[effects]\n{effects}\n')
    runs = {"multisine1": MULTISINE, **({"bias-sweep1": bias_sweep} if bias_sweep else {})}
    events = list(drive_simulated({**runs, "doublet": Doublet(count=1, straight=1)}, folder, variant))
    assert all(event.completed for event in events if isinstance(event, RunFinished))
    (saved,) = [event.path for event in events if isinstance(event, LogSaved)]
    return read_runs(str(saved))


def shown(run: Recording) -> Harmonics:
    return harmonics(run, MULTISINE, ("pwm", "r"))


def test_lopsided_steering_shows_at_even_lines(tmp_path: Path) -> None:
    runs = driven(tmp_path, ASYMMETRIC, BIAS_SWEEP)
    assert [run.kind for run in runs] == ["multisine", "bias_sweep", "doublet"]
    bent = runs[1].manoeuvre("pwm").x
    assert (bent.max(), bent.min()) == pytest.approx((1700, 1500), abs=1)
    assert np.median(bent[bent > 1500]) > 1580
    (by_telemetry,) = read_runs(str(tmp_path / "multisine1.tlog"))
    assert by_telemetry.kind == "multisine"
    for run in (runs[0], by_telemetry):
        levels = shown(run)
        assert levels["r"].second_detected and levels["r"].second > levels["pwm"].second + 10
        assert levels["r"].third < levels["r"].second - 6


@pytest.mark.slow
def test_cubic_linkage_shows_at_odd_lines_left_out(tmp_path: Path) -> None:
    levels = shown(driven(tmp_path, CUBIC)[0])
    assert levels["r"].third_detected and levels["r"].third > levels["pwm"].third + 10
    assert levels["r"].second < levels["r"].third - 6
