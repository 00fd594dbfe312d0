"""Steering stamped by another clock than the motion."""

from __future__ import annotations

from rover_sweep.diagnosis.effects.effect import Effect, EffectParameter, Values

USUAL_DELAY = 0.02  # s; an offset of the clocks cannot be told from the delay that every steering has


def stamped(found: Values) -> dict[str, tuple[float, str, str]]:
    """The offset, taking the usual delay for the rover's own."""
    return {"T": (USUAL_DELAY - found["T"], "s", "the steering is stamped late by T")}


EFFECT = Effect(
    id="clock_offset",
    title="clocks of steering and motion disagree",
    equation="u(t - T), the vehicle has no part in it",
    source="left_out_physics",
    parameters=(EffectParameter("T", "s", 0.06, -0.5, 0.5, "the steering's stamps are early by T"),),
    stage="servo",
    shows="as a transport delay, also a negative one",
    apart="only when two clocks stamped the streams; it may change from run to run, a delay does not",
    needs="streams of two clocks",
    excites="high frequency",
    next_run="the DataFlash log of the same run, in which one clock stamps everything",
    reads={"T": "delay"},
    shown=stamped,
    doubt={"T": 0.01},  # a usual delay is anything up to 40 ms
    releases={"delay": (-0.5, 0.5)},
)
