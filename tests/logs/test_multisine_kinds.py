"""A multisine and a sweep about a bias are recognised by their wave, and by what the applet said."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from drives import drive, signal

from rover_sweep.data.recording import steered
from rover_sweep.logs.find import find_runs
from rover_sweep.logs.wave import kind_of
from rover_sweep.manoeuvre.multisine import Multisine
from rover_sweep.manoeuvre.sweep import BiasSweep, Doublet, Manoeuvre, Sweep
from rover_sweep.quality.coherence import excited_range

MULTISINE = Multisine(t_rec=40)


@pytest.mark.parametrize("rate", [85.0, 40.0])
@pytest.mark.parametrize(
    "manoeuvre",
    [
        MULTISINE,
        Multisine(t_rec=40, periods=2),
        Multisine(t_rec=60, periods=6, w_max=12),
        BiasSweep(bias=100),
        BiasSweep(amplitude=80, bias=-200),
        Sweep(),
        Doublet(),
    ],
    ids=lambda m: m.kind,
)
def test_wave_alone_tells_the_kind(manoeuvre: Manoeuvre, rate: float) -> None:
    t = np.arange(0.0, manoeuvre.duration, 1 / rate)
    steering = signal(t, np.round(1500 + manoeuvre.wave(t)), "us", hold=True)
    assert kind_of(steering, 3.0, manoeuvre.duration - 3.0) == manoeuvre.kind


def weaving(t: np.ndarray) -> np.ndarray:
    """A driver that weaves: a sine whose pace and width wander."""
    rng = np.random.default_rng(3)
    wander = np.cumsum(rng.standard_normal((2, t.size)), axis=1) * np.sqrt(t[1] - t[0])
    return np.asarray((100 + 8 * wander[0]) * np.sin(2.0 * t + 0.4 * wander[1]))


def test_weaving_and_a_mere_sine_are_no_multisine() -> None:
    t = np.arange(0.0, 60.0, 0.02)
    for wave in (weaving(t), 100 * np.sin(2.0 * t), 80 * np.sin(2.0 * t) + 10 * np.sin(6.0 * t)):
        assert kind_of(signal(t, 1500 + wave, "us", hold=True), 0.0, 60.0) == "other"


@pytest.mark.parametrize(
    ("manoeuvre", "name"), [(Multisine(t_rec=40, w_max=12), "multisine"), (BiasSweep(t_rec=30), "bias sweep")]
)
def test_word_of_the_applet_counts(manoeuvre: Manoeuvre, name: str) -> None:
    log, (start,) = drive([manoeuvre])
    marks = ((start, f"SWP: run 1 start {name}"), (start + manoeuvre.duration, "SWP: run 1 done"))
    (run,) = find_runs(replace(log, marks=marks))
    assert run.kind == manoeuvre.kind
    slow = replace(log.steering[0], t=log.steering[0].t[::12], x=log.steering[0].x[::12])
    (run,) = find_runs(replace(log, marks=marks, steering=(slow,)))  # 8 Hz tell no wave
    assert run.kind == manoeuvre.kind


def test_word_counts_for_its_own_run_only() -> None:
    log, starts = drive([MULTISINE, Sweep(t_rec=30, w_min=0.8)])
    marks = (
        (starts[0], "SWP: run 1 start multisine"),
        (starts[0] + MULTISINE.duration, "SWP: run 1 done"),
        (starts[1], "SWP: run 2 start sweep"),
    )
    assert [run.kind for run in find_runs(replace(log, marks=marks))] == ["multisine", "sweep"]


def test_excited_range_goes_on_between_the_lines() -> None:
    log, _ = drive([Multisine()])
    (run,) = find_runs(log)
    low, high = excited_range([steered(run, 1500, 0.001)])
    assert low < 0.4 and 20 < high < 27
