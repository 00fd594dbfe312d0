"""What each effect adds to the rows of a fitted model, and the score test made from it.

The signature s of a parameter is the change of the model's whitened rows, f(x, size) - f(x, 0), for one size
of it: a difference quotient of the rows times the size. Let r be the residual rows of the fit without the
effect and P the projection onto the rows that the nominal coordinates cannot reach (`Tangent.outside`). To
first order, the effect in the amount a (in sizes), with the nominal model refitted, leaves

    |P (r - a s)|^2,   least for a = s^T P r / (s^T P s),   and lowers the cost by (s^T P r)^2 / (s^T P s)

s^T P r is the score of the parameter and s^T P s its information after the nominal ones are estimated, so
the drop is the score statistic of Rao (1948): chi-squared with one degree of freedom where the effect is
absent and the noise is all there is. It needs no fit with the effect. For several parameters, with the
columns S: r^T P S (S^T P S)^-1 S^T P r. `candidate_fits.linear_prediction` computes it from the data,
`plans.expected_posterior` what is expected of runs that are not driven.

Rao 1948: Large sample tests of statistical hypotheses concerning several parameters, Math. Proc. Cambridge
Philos. Soc. 44(1).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.effects import Effect, EffectParameter
from rover_sweep.diagnosis.problem.least_squares import Fitted
from rover_sweep.diagnosis.problem.residuals import Problem, whitened
from rover_sweep.diagnosis.simulation.candidates import DEGREES_OF_FREEDOM, Model
from rover_sweep.diagnosis.simulation.experiment import SPEED_ERROR
from rover_sweep.diagnosis.simulation.simulator import logged
from rover_sweep.diagnosis.simulation.structure import Structure
from rover_sweep.spectra.side_by_side import side_by_side


@dataclass(frozen=True, eq=False)
class Signature:
    """One parameter of one effect: the whitened rows (n,) that `size` of its coordinate adds."""

    effect: str
    parameter: str
    size: float
    rows: Array


def signatures(
    problem: Problem,
    base: Fitted,
    model: Model,
    effects: Sequence[Effect],
    at: Mapping[str, float] | None = None,
    tolerances: bool = False,
) -> list[Signature]:
    """Signatures of effects at a fitted model; of an effect in one run (a change of ground) one per run.

    at: {coordinate: size}, the parameter's own size where it is missing. tolerances: at the standard
    deviation that every rover has, only of parameters that have one.
    """
    now = problem.model(model.structure, base.x)
    wanted = [
        w
        for e in effects
        if e.id not in DEGREES_OF_FREEDOM
        for w in _wanted(problem, base, model, e, at or {}, tolerances)
    ]
    rows = side_by_side(lambda w: problem.model(w[3], w[4]) - now, wanted)
    return [Signature(e.id, p.name, size, r) for (e, p, size, _, _), r in zip(wanted, rows, strict=True)]


def _wanted(
    problem: Problem, base: Fitted, model: Model, effect: Effect, at: Mapping[str, float], tolerances: bool
) -> list[tuple[Effect, EffectParameter, float, Structure, dict[str, float]]]:
    out = []
    for run in problem.runs if effect.in_one_run else problem.runs[:1]:
        where = run.name if effect.in_one_run else ""
        structure = model.with_effect(effect.name, where, run.order).structure
        for p in effect.parameters:
            name = effect.coordinate_name(p)
            size = p.tolerance if tolerances else at.get(name, p.size)
            if p.name == "t" or size == 0.0 or (tolerances and p.nominal):
                continue
            x = {**base.x, name: base.x.get(name, 0.0) + size}
            if effect.in_one_run:
                x[effect.key("t")] = at.get(effect.key("t"), 0.5 * float(run.t[-1]))
            out.append((effect, p, size, structure, x))
    return out


def columns(found: Sequence[Signature], size: int) -> Array:
    """Their rows as columns (size, k); one column of zeros for none."""
    return np.column_stack([s.rows for s in found]) if found else np.zeros((size, 1))


# The slow error of the measured speed, a nuisance of every recording.
#
# The model is driven by the speed that an EKF estimates from GPS and accelerometer. The error of that speed,
# 1 or 2 cm/s, drifts within seconds and multiplies the yaw rate. The residual that it causes grows with the
# amplitude and would look like an effect.


FASTEST = 0.3  # Hz; over shorter times the accelerometer determines the estimate


def speed_drift(problem: Problem, fitted: Fitted) -> list[Signature]:
    """Signatures of the speed error: each run's cosines and sines up to `FASTEST`, one standard deviation."""
    return [one for run in range(len(problem.runs)) for one in _of_run(problem, fitted, run)]


def _of_run(problem: Problem, fitted: Fitted, index: int) -> Iterator[Signature]:
    run, sensors = problem.runs[index], problem.sensors[index]
    rows = tuple(r for r in problem.rows if r.run == index)
    now = logged(run, fitted.structure, fitted.x, sensors)
    length = float(run.t[-1])
    waves = int(FASTEST * length)

    def signature(wave: tuple[int, float]) -> Signature:
        number, phase = wave
        error = SPEED_ERROR / np.sqrt(waves) * np.cos(2 * np.pi * number * run.t / length + phase)
        moved = logged(replace(run, speed=run.speed + error), fitted.structure, fitted.x, sensors)
        change = {c: moved[c] - now[c] for c in moved}
        logs = [change if r == index else {} for r in range(len(problem.runs))]
        parts, start, column = whitened(rows, problem.runs, logs), 0, np.zeros(problem.size)
        for r in rows:
            column[r.start : r.start + r.size] = parts[start : start + r.size]
            start += r.size
        return Signature("speed", f"{run.name} {number}", SPEED_ERROR, column)

    return side_by_side(signature, [(n, p) for n in range(1, waves + 1) for p in (0.0, 0.5 * np.pi)])
