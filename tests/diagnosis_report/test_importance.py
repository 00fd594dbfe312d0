"""How much a finding matters, in plain figures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fabricated_diagnoses import BACKLASH

from rover_sweep.diagnosis.result import Diagnosis, Fit, HeldOut, TimeHistory
from rover_sweep.diagnosis.verdict import Turn, importance_words, turn_change, why_it_does_not_matter

FRICTION = replace(BACKLASH, held_out=(HeldOut("run5", Fit(1.31, 0.1), Fit(1.28, 0.1), 0.04),))
TURN = Turn(2.2, 0.2, 1.5, delay=0.05, rate=0.0, path=0.1)


def late_by(delay: float, gain: float) -> Diagnosis:
    t = np.arange(0.0, 30.0, 0.02)
    before, after = np.sin(1.3 * t), gain * np.sin(1.3 * (t - delay))
    w = np.ones(2)
    overlay = TimeHistory("run4", "r", True, t, after, before, after, 0.01, w, w, w)
    return Diagnosis("explained", "", "bicycle", findings=(BACKLASH,), overlays=(overlay,))


def test_an_effect_that_hardly_matters_says_so():
    assert (
        "4 % of the squared residual above the noise on run5 (J_rms, with the noise: 1.31 without"
        in importance_words(FRICTION)
    )
    assert "hardly shows" in importance_words(FRICTION)
    assert "hardly shows" not in importance_words(BACKLASH)
    assert "87 % of the squared residual above the noise on run4" in importance_words(BACKLASH)


def test_an_effect_whose_interval_holds_its_absence_does_not_matter():
    assert why_it_does_not_matter(absent=True) == "the 90 % interval of its size includes zero"
    assert why_it_does_not_matter(absent=False) == ""


def test_an_effect_that_changes_neither_a_turn_nor_a_run_does_not_matter():
    still = replace(TURN, delay=0.002, path=0.01)
    assert why_it_does_not_matter(False, still, 0.01) == "it changes no turn visibly"
    assert why_it_does_not_matter(False, TURN, 0.01) == ""
    assert why_it_does_not_matter(False, still, 0.05) == "", "a servo that sticks shows in a run only"
    assert why_it_does_not_matter(False, None, 0.0) == "", "a sensor has no part in a turn"


def test_the_delay_and_the_gain_of_a_turn():
    change = turn_change(late_by(0.12, 0.9))
    assert change == (pytest.approx(0.12, abs=0.004), pytest.approx(-0.1, abs=0.02))
    assert turn_change(replace(late_by(0.12, 0.9), findings=())) is None
