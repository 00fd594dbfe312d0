"""J_rms and TIC by hand, and the biases that are solved first."""

from dataclasses import replace

import numpy as np
import pytest
from synthetic import GEOMETRY, TRUE, driven

from rover_sweep.identification.models import roll_yaw
from rover_sweep.identification.verify import Overlay, theil, verify
from rover_sweep.manoeuvre.sweep import Doublet, Sweep

TRUTH = roll_yaw(GEOMETRY).with_values(TRUE)


def overlay(measured: list[float], model: list[float]) -> Overlay:
    return Overlay("r", "deg/s", np.arange(len(measured)) * 0.1, np.array(measured), np.array(model))


def test_theil_by_hand():
    one = overlay([3.0, -3.0, 3.0], [1.0, -1.0, 1.0])
    assert one.j_rms == pytest.approx(2.0)
    assert theil([one]) == pytest.approx(2.0 / (3.0 + 1.0))
    both = theil([one, overlay([0.0, 0.0], [4.0, 4.0])])
    assert both == pytest.approx(np.sqrt((4 + 16) / 2) / (np.sqrt(9 / 2) + np.sqrt((1 + 16) / 2)))


def test_accelerations_count_in_feet():
    """The guideline J_rms <= 2 means nothing in other units."""
    run = driven(TRUTH, Sweep(amplitude=120, t_rec=20))
    ay = run["ay"]
    raised = replace(ay, x=ay.x + 0.3048 * np.where(np.arange(ay.x.size) % 2, 1.0, -1.0))
    found = verify(TRUTH, replace(run, channels={**run.channels, "ay": raised}), channels=("ay",))
    assert found.overlays[0].unit == "ft/s^2"
    assert found.j_rms == pytest.approx(1.0, rel=0.02)


@pytest.mark.parametrize("channel", ["r", "p", "ay"])
def test_an_output_bias_is_solved_for_each_channel(channel: str):
    """A doublet is short compared with the roll mode, so state biases cannot replace those of the output."""
    run = driven(TRUTH, Sweep(amplitude=120, t_rec=20))
    signal = run[channel]
    biased = replace(run, channels={**run.channels, channel: replace(signal, x=signal.x + 0.2)})
    plain, found = verify(TRUTH, run), verify(TRUTH, biased)
    assert found.j_rms == pytest.approx(plain.j_rms, rel=0.05)
    assert found.output_biases[channel] - plain.output_biases[channel] == pytest.approx(0.2, abs=0.12)


def test_doublet_wave_goes_both_ways():
    wave = Doublet(amplitude=100, pulse=1, pause=2, count=1, straight=1)
    assert list(wave.wave(np.array([0.5, 1.5, 2.5, 3.5]))) == [0, 100, -100, 0]
