"""The ground changes.

    for the rest of the run: stiffness of both axles = C before t, ratio C from t on, in one run
    from then on:            the same, and ratio C in all runs driven later
    over ten seconds:        from C at t to ratio C at t + 10 s, then in all runs driven later
    one run:                 ratio C in one run
    all along:               ln C grows evenly with the time driven (tyres that warm up)

ratio [-]: ln(ratio) from -1.6 to 1.6. t [s]: from the start of the run's manoeuvre. The residual begins at
that instant; a repeat of the run on one ground confirms it. All along: ratio of the change in 300 s.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.effects.effect import EffectParameter, Values
from rover_sweep.diagnosis.effects.kinds import DriftEffect, GripEffect

RAMP = 10.0  # s
DRIFT = 300.0  # s of driving


def stiffness_factor(t: Array, q: Values) -> Array:
    """Factor of the stiffness (n,): 1 before the instant, the ratio from then on; t (n,) s."""
    return np.where(t >= q["t"], np.exp(q["ratio"]), 1.0)


def gradual(t: Array, q: Values) -> Array:
    """Factor of the stiffness (n,) that changes from t over `RAMP`; t (n,) s."""
    return np.asarray(np.exp(q["ratio"] * np.clip((t - q["t"]) / RAMP, 0.0, 1.0)))


def whole_run(t: Array, q: Values) -> Array:
    """The same factor (n,) in the whole run; t (n,) s."""
    return np.full(t.size, np.exp(q["ratio"]))


def drift(driven: Array, q: Values) -> Array:
    """Factor of the stiffness (n,) after a time driven (n,) s."""
    return np.asarray(np.exp(q["ratio"] * driven / DRIFT))


def _for_good(q: Values) -> float:
    return float(np.exp(q["ratio"]))


EFFECT = GripEffect(
    id="surface_change",
    title="the ground changed",
    equation="C jumps to ratio C at t",
    source="step change of the cornering stiffness",
    parameters=(
        EffectParameter(
            "ratio", "-", 0.3, -1.6, 1.6, "C after over C before", form="ratio", tolerance=0.015, matters=0.08
        ),
        EffectParameter("t", "s", 2.0, 0.0, 1e4, "instant, from the start of the run's manoeuvre"),
    ),
    apart="all other effects act during the whole run",
    next_run="repeat the run on one ground",
    act=stiffness_factor,
    baselines=("roll-yaw", "bicycle"),
    form="for the rest of the run",
)

_ONLY_RATIO = EFFECT.parameters[:1]
FORMS = (
    replace(
        EFFECT,
        first=False,
        form="from then on",
        equation="C jumps to ratio C at t, and stays so",
        later=_for_good,
    ),
    replace(
        EFFECT,
        first=False,
        form="over ten seconds",
        equation="C goes to ratio C from t to t + 10 s, and stays so",
        act=gradual,
        later=_for_good,
    ),
    replace(
        EFFECT,
        first=False,
        form="one run",
        equation="ratio C in one run",
        parameters=_ONLY_RATIO,
        act=whole_run,
    ),
    DriftEffect(
        id=EFFECT.id,
        title="the ground or the tyres change all along",
        equation="ln C grows by ln ratio in 300 s",
        source="tyres that warm up",
        parameters=_ONLY_RATIO,
        apart=EFFECT.apart,
        next_run="the first run again at the end",
        baselines=EFFECT.baselines,
        act=drift,
        first=False,
        form="all along",
    ),
)
