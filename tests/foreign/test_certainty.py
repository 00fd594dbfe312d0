"""The probability of a finding: what it depends on, and that its calibration would show a wrong one."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from rover_sweep.diagnosis.certainty import LEAST, MOST, measures, probability
from tests.foreign.certainty import Judged, apart, fitted, judged, table

CLEAR = {"gain": 900.0, "threshold": 20.0, "runner_up": 0.3, "remaining": 0.02}
HELD_OUT = {"held_out_gain": 95.0, "held_out_expected": 100.0}


def test_more_gain_and_a_held_out_run_make_a_finding_surer() -> None:
    faint = probability(CLEAR | {"gain": 30.0})
    clear, judged_too = probability(CLEAR), probability(CLEAR | HELD_OUT)
    assert faint is not None and clear is not None and judged_too is not None
    assert LEAST <= faint < clear < judged_too <= MOST


def test_without_its_measures_a_finding_has_no_probability() -> None:
    assert probability({"gain": 900.0, "threshold": 20.0}) is None


def test_findings_are_read_with_the_truth_beside_them(tmp_path: Path) -> None:
    finding = {"effect": "imu_tilt", "look_alikes": [], "evidence": CLEAR}
    sets = [
        {"hidden": [{"effect": "imu_tilt"}], "findings": [finding]},
        {"hidden": [], "findings": [finding]},
        {
            "hidden": [{"effect": "outside:tyre_left_right"}],
            "findings": [finding | {"effect": "steering_asymmetry"}],
        },
    ]
    lines = [json.dumps({"set": "1", "verdict": "explained", "seconds": 1.0, **one}) for one in sets]
    path = tmp_path / "drawn.json"
    path.write_text("\n".join(lines))
    assert [one.right for one in judged([path])] == [True, False]


def test_weights_fitted_apart_are_calibrated_and_wrong_ones_show() -> None:
    random = np.random.default_rng(3)
    found = []
    for _ in range(600):
        z = measures(CLEAR | {"gain": 20.0 * np.exp(random.uniform(0.0, 5.0))})
        found.append(Judged(z, 0.95, bool(random.random() < 1.0 / (1.0 + np.exp(1.0 - z["clear"])))))
    assert fitted(found)["clear"] == pytest.approx(1.0, abs=0.2)
    for said, n, _, low, high in table(apart(found)):
        assert n < 20 or low - 0.03 < said < high + 0.03
    (said, n, _, _, high) = table([(f.said, f.right) for f in found])[-1]
    assert n == 600 and high < said
