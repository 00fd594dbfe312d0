"""How much a finding matters: its part in a turn."""

from __future__ import annotations

import numpy as np
import pytest
from planted import MODEL, X, sweeps

from rover_sweep.diagnosis.simulation.simulator import FittedModel
from rover_sweep.diagnosis.verdict import turn_sentence, turn_with

RUNS = sweeps(1)[:1]


def fitted(effect: str, **values: float) -> FittedModel:
    return FittedModel(
        MODEL.with_effect(effect), {**X, **{k.replace("__", "."): v for k, v in values.items()}}
    )


def test_a_transport_delay_is_added_to_the_start_of_each_turn() -> None:
    """0.12 s more than the normal 0.015 s: the same path later, V x 0.12 s apart."""
    turn = turn_with("transport_delay", fitted("transport_delay", delay=0.135), RUNS)
    assert turn is not None
    assert turn.delay == pytest.approx(0.12, abs=0.01) and abs(turn.rate) < 0.01
    assert turn.turned == pytest.approx(np.pi / 2, abs=0.03)
    assert turn.path == pytest.approx(0.12 * turn.speed * np.sqrt(2), rel=0.15)


def test_the_sentence_has_the_figures() -> None:
    words = turn_sentence(turn_with("transport_delay", fitted("transport_delay", delay=0.135), RUNS))
    assert "adds 0.12 s to its start" in words and words.endswith("m off")
    assert turn_with("sensor_scale", fitted("sensor_scale", sensor_scale__gyro=0.1), RUNS) is None
    assert turn_sentence(None) == ""


def test_a_scale_makes_turns_tighter() -> None:
    turn = turn_with("steering_scale", fitted("steering_scale", scale=0.1), RUNS)
    assert turn is not None and turn.rate == pytest.approx(0.1, abs=0.01) and abs(turn.delay) < 0.01


def test_what_does_not_move_the_rover_has_no_turn() -> None:
    assert turn_with("sensor_scale", fitted("sensor_scale", sensor_scale__gyro=0.1), RUNS) is None
    assert turn_with("clock_offset", fitted("clock_offset", delay=-0.1), RUNS) is None
