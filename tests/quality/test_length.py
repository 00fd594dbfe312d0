"""Runs too short for their noise have a fault of their own; whole ones and pieces that add up have none."""

from __future__ import annotations

from dataclasses import replace

import pytest
from damage import NOMINAL

import rover_sweep as rs
from rover_sweep.api.diagnosis_input import Material, diagnosed
from rover_sweep.data.recording import Recording
from rover_sweep.data.vehicle_geometry import geometry_of
from rover_sweep.diagnosis.result import DiagnosisSettings
from rover_sweep.identification.grouping import Settings
from rover_sweep.identification.pipeline import identify
from rover_sweep.quality.faults import (
    TOO_SHORT,
    each_with_length,
    needed,
    short_trials,
    too_short,
    with_length,
)
from rover_sweep.quality.verdict import assess

VEHICLE = NOMINAL.parents[1] / "rover.toml"
SAID = "of driving, but 16 s are needed (5 periods of 2 rad/s) for a random error of 10 %; drive one complete"


def piece(run: Recording, start: float, length: float) -> Recording:
    """A trial of `length` [s] from `start` [s] of the manoeuvre on, with nothing recorded around it."""
    begin = run.span[0] + start
    channels = {c: s.between(begin, begin + length) for c, s in run.channels.items()}
    return replace(run, span=(begin, begin + length), channels=channels, standstill=(), straight=())


@pytest.fixture(scope="module")
def runs() -> rs.Runs:
    return rs.read(NOMINAL / "run1.BIN", NOMINAL / "run2.BIN", vehicle=VEHICLE)


@pytest.mark.parametrize("length", [4.0, 8.0, 15.0])
@pytest.mark.parametrize("start", [2.0, 20.0, 40.0])
def test_a_short_trial_is_named(runs: rs.Runs, length: float, start: float) -> None:
    (run,) = each_with_length([piece(runs[0], start, length)])
    (fault,) = (note for note in run.notes if note.fault)
    assert fault.fault == TOO_SHORT
    assert fault.text.startswith(f"too short: {length:.1f} s {SAID}")
    assert assess(run).sentence == f"repeat: {fault.text}" and not assess(run).keep


def test_no_model_of_a_short_trial_is_good(runs: rs.Runs) -> None:
    assert runs.vehicle is not None
    short = piece(runs[0], 44.0, 15.0)
    found = identify([short], geometry_of(runs.vehicle), (), Settings(models=("bicycle",)))
    assert found.recommended is None and any(SAID in words for words in found.summary)
    assert {m.verdict.level for m in found.models.values()} <= {"poor", "not identifiable"}


def test_a_trial_that_gives_nothing_is_called_short_first(runs: rs.Runs) -> None:
    """4 s at the end of a sweep, of which nothing but a wrong sign of the steering was said."""
    assert runs.vehicle is not None
    short = piece(runs[1], 55.0, 4.0)
    found = identify([short], geometry_of(runs.vehicle), (), Settings(models=("bicycle",)))
    assert found.summary[0].startswith("nothing can be identified: too short: 4.0 s")


def test_a_diagnosis_refuses_short_trials(runs: rs.Runs) -> None:
    assert runs.vehicle is not None
    given = Material((piece(runs[0], 20.0, 8.0),), (runs[0],))
    found = diagnosed(given, runs.vehicle, DiagnosisSettings())
    assert found.verdict == "refused" and "too short: 8.0 s" in found.sentence


def test_pieces_count_together(runs: rs.Runs) -> None:
    pieces = [piece(runs[0], start, 10.0) for start in (5.0, 20.0)]
    assert too_short(pieces[:1]) and too_short(pieces) is None
    assert with_length(pieces) == tuple(pieces)


def test_five_short_trials_are_repeats(runs: rs.Runs) -> None:
    """T_F/5 is the longest window, so that each trial is one average of its whole length."""
    crumbs = [piece(runs[0], start, 4.0) for start in range(5, 50, 4)]
    assert too_short(crumbs) is None and short_trials(crumbs)
    assert (fault := too_short(crumbs[:4])) and fault.text.startswith("too short: 4 runs of at most 4.0 s")
    assert too_short([piece(runs[0], start, 1.0) for start in range(5, 35)])


def test_a_fit_from_a_higher_frequency_needs_less() -> None:
    assert needed(4.0) == pytest.approx(needed() / 2)
    assert needed(0.3) == needed()


def test_what_was_driven_by_hand_counts_together(runs: rs.Runs) -> None:
    by_hand = [replace(piece(runs[0], start, 9.0), kind="other") for start in (5.0, 20.0)]
    assert each_with_length(by_hand) == tuple(by_hand)
    assert all(run.notes[-1].fault == TOO_SHORT for run in each_with_length(by_hand[:1]))
    doublet = replace(by_hand[0], kind="doublet")
    assert each_with_length([doublet]) == (doublet,)
