"""A planted signal is reported where it was planted; without one, nothing is reported."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import pytest
from planted import located, over

from rover_sweep.data.geometry import GRAVITY
from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.simulation.experiment import Experiment
from rover_sweep.manoeuvre.sweep import Sweep


def phase(run: Experiment) -> Array:
    """Phase of the sweep (n,) rad, 0 before it begins."""
    law = Sweep()
    since = run.t - law.straight
    return np.where(
        since < 0, 0.0, law.phase(since - law.fade - law.dwell) + law.w_min * (law.fade + law.dwell)
    )


@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_without_a_planted_signal_nothing_is_reported(seed: int) -> None:
    assert located(lambda run: {}, seed) == ()


def test_a_tone_is_found_in_its_channel_and_band() -> None:
    found = located(lambda run: {"p": 0.1 * np.sin(6.0 * run.t)})
    assert {m.channel for m in found} == {"p"}
    assert found[0].band[0] < 6.0 < found[0].band[1] < 9.0
    assert found[0].profile is not None and found[0].profile.over == "frequency"


@pytest.mark.parametrize(("order", "words"), [(2, "2nd harmonic"), (3, "3rd harmonic")])
def test_a_harmonic_is_reported_with_its_order(order: int, words: str) -> None:
    (found,) = over(
        located(lambda run: {"r": 0.03 * np.sin(order * phase(run)) * (run.taper > 0.5)}), "harmonic"
    )
    assert (found.channel, found.condition) == ("r", words)


def test_a_proportional_residual_has_no_harmonic_and_no_amplitude() -> None:
    found = located(lambda run: {"r": 0.2 * run.measured["r"]})
    assert found[0].channel == "r" and found[0].residual_over_noise > 3
    assert not any(over(found, of) for of in ("harmonic", "amplitude", "turn", "time", "heading"))


def test_a_steady_turn_is_reported_with_its_side_and_size() -> None:
    (found,) = (m for m in located(lambda run: {"r": np.full(run.t.size, -0.05)}) if m.condition == "steady")
    assert found.channel == "r"
    assert "2.9 deg/s further to the right" in found.sentence  # .05 rad/s


def test_left_and_right_turns_are_separated() -> None:
    (found,) = over(located(lambda run: {"r": 0.1 * np.maximum(run.measured["r"], 0.0)}), "turn")
    assert found.condition == "left turns" and found.profile is not None
    left, right = found.profile.ratio
    assert left > 5 * abs(right)
    (found,) = over(located(lambda run: {"r": 0.1 * np.minimum(run.measured["r"], 0.0)}), "turn")
    assert found.condition == "right turns"


@pytest.mark.parametrize(
    ("bent", "words"),
    [
        (lambda run: 8.0 * run.measured["r"] ** 3 / 9.0, "grows more than in proportion to amplitude"),
        (lambda run: 0.04 * np.tanh(100 * run.steer), "hardly grows with amplitude"),
    ],
)
def test_growth_with_the_amplitude(bent: Callable[[Experiment], Array], words: str) -> None:
    (found,) = over(located(lambda run: {"r": bent(run)}), "amplitude")
    assert found.channel == "r" and found.condition == words
    assert found.profile is not None and found.profile.x == pytest.approx((5.73, 11.46), rel=0.01)


def test_the_speed_at_which_it_differs() -> None:
    def slow_only(run: Experiment) -> Mapping[str, Array]:
        return {"r": (0.2 if run.mean_speed < 1.8 else 0.05) * run.measured["r"]}  # .2/1.2, .05/1.05

    (found,) = over(located(slow_only), "speed")
    assert found.condition == "1.40 m/s"
    assert "17 % of the motion, against 5 % at 2.20 m/s" in found.sentence


def test_the_instant_from_which_a_run_differs() -> None:
    def changed(run: Experiment) -> Mapping[str, Array]:
        return {"r": 0.2 * run.measured["r"] * (run.t > 45.0) * (run.name == "run2")}

    (found,) = over(located(changed), "time")
    assert found.condition.startswith("run2 from ")
    assert float(found.condition.split()[2]) == pytest.approx(45.0, abs=1.5)


def test_a_slope_is_reported_by_the_heading() -> None:
    (found,) = over(located(lambda run: {"ay": 0.06 * GRAVITY * np.cos(run.heading - np.pi / 2)}), "heading")
    assert found.channel == "ay" and found.condition == "heading west"
    assert found.profile is not None
    assert found.profile.x == ("N", "NE", "E", "SE", "S", "SW", "W", "NW")
    bars = dict(zip(found.profile.x, found.profile.ratio, strict=True))
    assert max(bars, key=bars.__getitem__) == "W" and bars["E"] == pytest.approx(-bars["W"])


def test_the_list_is_short_and_begins_with_the_largest() -> None:
    def all_of_it(run: Experiment) -> Mapping[str, Array]:
        y = run.measured
        return {
            c: 0.3 * np.maximum(y[c], 0.0) + 5 * s * np.tanh(100 * run.steer) + 2 * s
            for c, s in {"r": 0.01, "ay": 0.1, "p": 0.03, "vy": 0.01}.items()
        }

    found = located(all_of_it)
    sizes = [m.residual_over_noise for m in found]
    assert 5 <= len(found) <= 8 and sizes == sorted(sizes, reverse=True)
    assert len({m.sentence for m in found}) == len(found)
