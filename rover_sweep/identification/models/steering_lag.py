"""A model with a first-order lag between steering command and road wheels, in addition to its delay."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from rover_sweep.identification.cost import Condition
from rover_sweep.identification.fit import FitResult, fit
from rover_sweep.identification.structure.state_space import Matrices, ModelStructure, Parameter

STARTS = ({"T_s": 0.06},)
LAG = Parameter("T_s", "s", 0.02, True, 5e-4, 0.3, "first-order lag of the steering")


def with_steering_lag(structure: ModelStructure) -> ModelStructure:
    """The structure driven by delta, with T_s delta' = u - delta as one more state; T_s [s] is free.

    For structures with one input. A servo loses gain at high frequencies, a pure delay does not: without the
    lag a fit lowers the front stiffness instead, which changes the understeer gradient.
    """
    build = structure.build

    def lagged(p: Mapping[str, Any]) -> Matrices:
        inner = build(p)
        n, outputs = inner.f.shape[0], inner.h0.shape[0]
        row, none = np.zeros((1, n)), np.zeros((outputs, 1))
        steering = inner.input_matrix
        return Matrices(
            m=np.block([[inner.m, row.T], [row, np.array([[p[LAG.name]]])]]),
            f=np.block([[inner.f, steering], [row, -np.ones((1, 1))]]),
            g=np.concatenate((np.zeros(n), np.ones(1))),
            h0=np.hstack([inner.h0, none]),
            h1=np.hstack([inner.h1, none]),
        )

    return replace(
        structure, states=(*structure.states, "delta"), parameters=(*structure.parameters, LAG), build=lagged
    )


def lagged_fit(found: FitResult, conditions: Sequence[Condition]) -> FitResult:
    """A refit of a fit's model with a steering lag, T_s [s], in addition. conditions: data of the fit."""
    return fit(with_steering_lag(found.structure), conditions, STARTS)


def refitted_with_lag(found: FitResult, conditions: Sequence[Condition]) -> FitResult:
    """A fit's model at the parameters, and with their covariance, of a refit with a steering lag.

    conditions: data of the fit. The lag itself is left out of the result, whose costs and estimates are those
    of `found`.
    """
    lagged = lagged_fit(found, conditions)
    names = [p.name for p in lagged.structure.free]
    kept = [names.index(p.name) for p in found.structure.free]
    assert lagged.covariance is not None
    values = {p.name: p.value for p in lagged.structure.free if p.name != LAG.name}
    return replace(
        found, structure=found.structure.with_values(values), covariance=lagged.covariance[np.ix_(kept, kept)]
    )
