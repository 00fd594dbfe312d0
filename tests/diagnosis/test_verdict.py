"""Verdicts: explained only at the noise floor; findings that a held-out run contradicts are reported."""

from types import SimpleNamespace

import numpy as np
import pytest

from rover_sweep.data.results import Quantity
from rover_sweep.diagnosis.result import Finding, Fit, HeldOut, Unknown
from rover_sweep.diagnosis.verdict import remarks_of, sentence_of, verdict_of

UNKNOWN = Unknown("r", "phi", 2.0, "r still differs", "residual of r ~ phi", 0.5)


def finding(*shares: float | None) -> Finding:
    fit = Fit(1.0, 0.1)
    held = tuple(HeldOut(f"run{k + 4}", fit, fit, share) for k, share in enumerate(shares))
    value = Quantity("b", "rad", 0.01, 0.009, 0.011)
    return Finding("steering_backlash", (), (value,), {}, held, "", "backlash, b = .01 rad", "")


@pytest.mark.parametrize(
    ("findings", "left", "variance", "verdict"),
    [
        ((), None, 1.1, "none"),
        ((), None, 3.0, "none"),
        ((), UNKNOWN, 3.0, "unexplained"),
        ((finding(),), None, 1.1, "explained"),
        ((finding(),), None, 3.0, "partly explained"),
        ((finding(),), UNKNOWN, 3.0, "partly explained"),
    ],
)
def test_explained_is_at_the_noise_floor(
    findings: tuple[Finding, ...], left: Unknown | None, variance: float, verdict: str
) -> None:
    assert verdict_of(findings, left, variance) == verdict


def test_the_remaining_residual_is_given_in_multiples_of_the_noise() -> None:
    assert "2.0 times the noise floor" in sentence_of((finding(),), None, 4.0)
    assert sentence_of((), None, 1.0).startswith("these runs show no missing effect")
    assert sentence_of((), None, 1.0, listed=True).startswith("nothing that matters was found")
    unsure = sentence_of((), None, 1.0, possible={"imu_offset": 0.67, "roll_steer": 0.12})
    assert unsure == "no effect is sure enough for a name; the most probable is imu_offset (67 %)"


def test_a_partly_explained_diagnosis_is_one_sentence_without_the_details() -> None:
    left = Unknown("r", "phi", 2.0, "r still differs; no candidate explains it; it has no pattern", "", None)
    found = sentence_of((finding(),), left, 3.0)
    assert found == "backlash, b = .01 rad, explains a part, but r still differs"
    assert sentence_of((), left, 3.0) == "r still differs, and no candidate explains it"


def test_a_finding_that_a_held_out_run_contradicts_is_reported() -> None:
    assert remarks_of([], [finding(0.4, -0.1, None)], {}, {}, {})[-1].endswith("worse on run5")
    assert not any("not confirmed" in remark for remark in remarks_of([], [finding(0.4, None)], {}, {}, {}))


@pytest.mark.parametrize(("slowest", "fastest", "told"), [(2.0, 2.1, True), (1.0, 3.0, False)])
def test_one_run_that_speeds_up_is_not_of_one_speed(slowest: float, fastest: float, told: bool) -> None:
    run = SimpleNamespace(speed=np.linspace(slowest, fastest, 3000), amplitude=0.2)
    found = remarks_of([run], [], {}, {}, {})  # type: ignore[list-item]
    assert any("the same speed" in remark for remark in found) == told


def test_effects_that_are_not_named_are_listed_with_the_reason() -> None:
    minor, listed = {"roll_steer": "it is below the size that matters"}, {"imu_offset": 0.42}
    found = remarks_of([], [], minor, listed, {})
    assert "roll_steer is present and does not matter: it is below the size that matters" in found
    assert "imu_offset is possible (42 %), but not sure enough for a name" in found
