"""How much a finding matters, in plain figures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fabricated_diagnoses import BACKLASH

from rover_sweep.diagnosis.importance import importance_words, is_nothing, turn_change, turn_words
from rover_sweep.diagnosis.result import Diagnosis, EffectValue, Fit, HeldOut, Overlay

FRICTION = replace(BACKLASH, held_out=(HeldOut("run5", Fit(1.31, 0.1), Fit(1.28, 0.1), 0.04),))
K = EffectValue("k", "-", 0.0, None, None)


def late_by(delay: float, gain: float) -> Diagnosis:
    t = np.arange(0.0, 30.0, 0.02)
    before, after = np.sin(1.3 * t), gain * np.sin(1.3 * (t - delay))
    w = np.ones(2)
    overlay = Overlay("run4", "r", True, t, after, before, after, 0.01, w, w, w)
    return Diagnosis("explained", "", "bicycle", findings=(BACKLASH,), overlays=(overlay,))


def test_an_effect_that_hardly_matters_says_so():
    assert (
        "4 % of the squared residual above the noise on run5 (J_rms, with the noise: 1.31 without"
        in importance_words(FRICTION)
    )
    assert "hardly matters" in importance_words(FRICTION)
    assert "hardly matters" not in importance_words(BACKLASH)
    assert "87 % of the squared residual above the noise on run4" in importance_words(BACKLASH)


@pytest.mark.parametrize(
    ("share", "value", "nothing"), [(0.0, 0.4, True), (0.3, 0.0, True), (0.3, 0.4, False)]
)
def test_findings_of_nothing(share, value, nothing):
    held_out = (HeldOut("run5", Fit(1.31, 0.1), Fit(1.31, 0.1), share),)
    assert is_nothing(replace(BACKLASH, held_out=held_out, parameters=(replace(K, value=value),))) is nothing


def test_a_finding_without_held_out_runs_is_kept():
    assert not is_nothing(replace(BACKLASH, held_out=()))


def test_the_delay_and_the_gain_of_a_turn():
    change = turn_change(late_by(0.12, 0.9))
    assert change.delay == pytest.approx(0.12, abs=0.004)
    assert change.gain == pytest.approx(-0.1, abs=0.02)
    assert "starts each turn 0.12 s later" in turn_words(late_by(0.12, 0.9))
    assert "10 % less" in turn_words(late_by(0.12, 0.9))
    assert "less than 5 ms and 1 %" in turn_words(late_by(0.0, 1.0))
