"""Keep, repeat or discard, and why: the fault that was made is the fault that is named, in time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rover_sweep.data import vehicle_file
from rover_sweep.data.recording import Recording, Signal
from rover_sweep.live.verdict import judge, verdict_on_run
from rover_sweep.logs.log import Log
from rover_sweep.logs.read import read_logs, read_runs

ROOT = Path(__file__).parents[2]
SWEEP = "ardurover-4.6.3/applet/run1.tlog"
WHOLE = (0.0, 1e9)


@pytest.fixture(scope="module")
def log(data: Path) -> Log:
    (found,) = read_logs(str(data / SWEEP))
    return found


@pytest.fixture(scope="module")
def run(data: Path) -> Recording:
    (found,) = read_runs(str(data / SWEEP))
    return found


Change = Callable[[Signal], np.ndarray]


def changed(run: Recording, **channels: Change) -> Recording:
    new = {name: replace(run[name], x=change(run[name])) for name, change in channels.items()}
    return replace(run, channels={**run.channels, **new})


def noisy(sd: float, share: float = 1.0, seed: int = 1) -> Change:
    """`share` of the signal, in white noise."""
    return lambda s: share * s.x + sd * np.random.default_rng(seed).standard_normal(s.x.size)


def test_a_good_run_is_kept_with_its_bands_in_words(data: Path) -> None:
    verdict = judge(data / SWEEP, WHOLE, "sweep1")
    assert (verdict.run, verdict.advice, verdict.source) == ("sweep1", "keep", data / SWEEP)
    assert verdict.sentence.startswith("keep: ")
    words = {(b.response, b.words) for b in verdict.bands}
    assert ("r", "good") in words and ("vydot", "weak: the GPS bends the speed") in words
    assert {r for r, w in words} == {"r", "ay", "p", "vydot"}
    assert any(
        r.startswith("vydot: weak below 3.") and "the GPS bends the speed" in r for r in verdict.remarks
    )
    for name in ("r", "p"):
        octaves = [(b.low, b.high) for b in verdict.bands if b.response == name]
        assert all(high / low == pytest.approx(2.0, rel=0.2) for low, high in octaves)
        assert octaves[0][0] < 0.3 and octaves[-1][1] > 24.0
    assert verdict.amplitude is None and len(verdict.per_band) == 7


@pytest.mark.parametrize(
    ("changes", "advice", "words"),
    [
        ({"r": noisy(0.5, share=0.0)}, "discard", "does not follow the steering"),
        ({"ay": lambda s: -s.x}, "discard", "AHRS_ORIENTATION"),
        ({"r": lambda s: s.x + 0.5}, "repeat", "drive straighter: the rover turns left"),
        ({"r": lambda s: s.x - 0.5}, "repeat", "drive straighter: the rover turns right"),
        ({"speed": lambda s: s.x * np.linspace(0.4, 1.6, s.x.size)}, "repeat", "at a steady speed"),
        ({"ay": noisy(5.0)}, "repeat", "repeat with"),
    ],
)
def test_the_fault_is_named(run: Recording, changes: dict[str, Change], advice: str, words: str) -> None:
    # the standstill tells the gyro's bias, so that a constant in r would be taken for one
    verdict = verdict_on_run(replace(changed(run, **changes), standstill=()))
    assert verdict.advice == advice, verdict.sentence
    assert words in verdict.sentence


def test_more_amplitude_is_proposed_for_noise(run: Recording) -> None:
    verdict = verdict_on_run(changed(run, ay=noisy(2.0)))
    assert verdict.advice == "repeat" and verdict.amplitude is not None
    assert f"repeat with {verdict.amplitude:.0f} us in place of 150" in verdict.sentence
    assert "coherence of ay is below 0.6" in verdict.sentence
    assert verdict.amplitude == max(us for _, _, us in verdict.per_band)


def test_where_the_limits_allow_no_more_the_frequency_is_lowered(run: Recording) -> None:
    w_max = {}
    for limit in (400.0, 170.0):
        tight = replace(run, limits={**run.limits, "SWP_PWM_MAX": limit})
        verdict = verdict_on_run(changed(tight, ay=noisy(3.0)))
        assert verdict.advice == "repeat" and verdict.amplitude is not None and verdict.amplitude <= limit
        assert all(us <= limit for _, _, us in verdict.per_band)
        w_max[limit] = float(verdict.sentence.partition("lower w_max to ")[2].split()[0])
    assert "SWP_PWM_MAX allows 170 us" in verdict.sentence
    assert 1.0 < w_max[170.0] < w_max[400.0] < 25.0


def test_the_vehicle_file_tells_the_sign_of_the_steering(run: Recording, data: Path) -> None:
    rover = vehicle_file.load(data / "rover.toml")
    assert rover.rad_per_us is not None
    assert verdict_on_run(run, rover).advice == "keep"
    wrong = replace(rover, rad_per_us=replace(rover.rad_per_us, value=-rover.rad_per_us.value))
    verdict = verdict_on_run(run, wrong)
    assert verdict.advice == "discard" and "rad_per_us" in verdict.sentence
    turned = changed(run, pwm=lambda s: 3000.0 - s.x)
    assert any("a larger PWM turns this rover left" in r for r in verdict_on_run(turned).remarks)
    assert not any("turns this rover left" in r for r in verdict_on_run(run).remarks)


def test_a_doublet_is_kept_without_a_word_on_coherence(data: Path) -> None:
    verdict = judge(data / "ardurover-4.6.3/defaults/run2.tlog", WHOLE, "doublet")
    assert verdict.advice == "keep" and "doublet" in verdict.sentence and not verdict.bands


def test_what_cannot_be_judged_is_said_in_a_sentence(data: Path, tmp_path: Path) -> None:
    (tmp_path / "empty.tlog").write_bytes(b"")
    empty = judge(tmp_path / "empty.tlog", WHOLE, "sweep1")
    assert empty.advice == "repeat" and "empty" in empty.sentence
    elsewhere = judge(data / SWEEP, (0.0, 10.0), "sweep1")
    assert elsewhere.advice == "discard" and "no run was found between 0 and 10 s" in elsewhere.sentence
    still = (data / SWEEP).read_bytes()[:60_000]  # up to before it drives
    (tmp_path / "still.tlog").write_bytes(still)
    assert "never drove" in judge(tmp_path / "still.tlog", WHOLE, "sweep1").sentence
