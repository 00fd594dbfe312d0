"""The road-wheel angle of a run: the commanded one through delay, command, servo, linkage and trim."""

from __future__ import annotations

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.effects.kinds import CommandEffect, LinkageEffect, ServoEffect
from rover_sweep.diagnosis.simulation.experiment import FINE, RATE, Experiment
from rover_sweep.diagnosis.simulation.kernel import servo
from rover_sweep.diagnosis.simulation.structure import Structure, Values

STEP = 1.0 / RATE
WHEEL = ("scale", "delay", "lag", "lag_shape", "trim")  # coordinates of the wheel angle


def wheel_angle(run: Experiment, structure: Structure, x: Values) -> Array:
    """Road-wheel angle (n,) rad from the commanded one through delay, command, servo, linkage and trim.

    The run keeps the last eight, since most columns of a Jacobian share theirs; it must not be written to.
    """
    limits = {name: value for e in structure.of(ServoEffect) for name, value in e.numbers(x).items()}
    acting = (*structure.of(CommandEffect), *structure.of(LinkageEffect))
    laws = tuple((e.act, *e.coordinates(x).items()) for e in acting)
    key = (laws, tuple(limits.items()), *(x.get(name, 0.0) for name in WHEEL))
    found = run.angles.get(key)
    if found is None:
        if len(run.angles) >= 8:
            run.angles.clear()
        found = run.angles[key] = _wheel_angle(run, structure, x, limits.get("inv_rate", 0.0))
    return found


def _wheel_angle(run: Experiment, structure: Structure, x: Values, inv_rate: float) -> Array:
    d = late(run.fine_steer * (1.0 + x.get("scale", 0.0)), x.get("delay", 0.0) * FINE * RATE)
    for effect in structure.of(CommandEffect):
        d = effect.act(d, effect.coordinates(x))
    lag, shape = max(x.get("lag", 0.0), 0.0), x.get("lag_shape", 0.0)
    d = servo(d, lag, shape, inv_rate, STEP / FINE)[::FINE].copy()
    for linkage in structure.of(LinkageEffect):
        d = linkage.act(d, linkage.coordinates(x))
    return d - x.get("trim", 0.0)


def late(u: Array, shift: float) -> Array:
    """u (n,) delayed by `shift` samples, a cubic through four samples between them."""
    if shift == 0.0:
        return u
    whole = int(np.floor(shift))
    x = shift - whole
    padded = np.pad(u, (abs(whole) + 2, abs(whole) + 2), "edge")
    first = abs(whole) + 2 - whole  # of u[k - whole] in the padded signal
    at = [padded[first - j : first - j + u.size] for j in (-1, 0, 1, 2)]
    weights = (
        -x * (x - 1.0) * (x - 2.0) / 6.0,
        (x + 1.0) * (x - 1.0) * (x - 2.0) / 2.0,
        -(x + 1.0) * x * (x - 2.0) / 2.0,
        (x + 1.0) * x * (x - 1.0) / 6.0,
    )
    return np.asarray(sum(w * part for w, part in zip(weights, at, strict=True)))
