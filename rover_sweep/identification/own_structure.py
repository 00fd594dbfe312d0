"""A user's own structure, fitted to the runs like the built-in models."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rover_sweep.identification.cost import Condition, costs
from rover_sweep.identification.fit import fit, has_zero_response
from rover_sweep.identification.model_results import ModelResult, NotPossible, Work, fitted_result
from rover_sweep.identification.starts import drawn_starts
from rover_sweep.identification.structure.state_space import OUTPUTS, ModelStructure


def own_result(structure: ModelStructure, work: Work) -> ModelResult:
    """The fit of a structure over all speeds to the fitted responses that it has, verified and judged.

    Raises NotPossible with the reason when the runs do not allow it.
    """
    for name in structure.inputs[1:]:
        if any(name not in g.others for g in work.groups):
            raise NotPossible(
                f"{structure.name} has the input {name}, but the responses are not conditioned on it: add "
                f"--condition-on {name} and use runs in which it was recorded and moves"
            )
    if unknown := [o for o in structure.outputs if o not in OUTPUTS]:
        raise NotPossible(
            f"{structure.name} has the output {unknown[0]!r}; outputs can be {', '.join(OUTPUTS)}"
        )
    if not structure.free:
        raise NotPossible(f"{structure.name} has no free parameter, so there is nothing to identify")
    outputs = [o for o in structure.outputs if o in work.settings.fitted]
    conditions = work.conditions(outputs or structure.outputs)
    if not all(c.data for c in conditions):
        raise NotPossible(
            f"{structure.name} cannot be identified: none of its outputs ({', '.join(structure.outputs)}) "
            "has a usable band in the fitted responses"
        )
    if not _has_finite_responses(structure, conditions):
        raise NotPossible(
            f"{structure.name} has no finite nonzero response at {work.groups[0].speed:.2f} m/s: change its "
            "starting values"
        )
    starts = [
        s for s in drawn_starts(structure) if _has_finite_responses(structure.with_values(s), conditions)
    ]
    best = fit(structure, conditions, starts)
    variants = {}
    if any(g.runs[0].filters for g in work.groups):
        bare = work.conditions(outputs or structure.outputs, filtered=False)
        variants["filters ignored"] = fit(best.structure, bare)
    return fitted_result(best, variants, work)


def _has_finite_responses(structure: ModelStructure, conditions: Sequence[Condition]) -> bool:
    """True when every response of the structure is finite and nonzero."""
    try:
        with np.errstate(all="ignore"):
            whole = list(costs(structure, conditions).values())
            return bool(np.all(np.isfinite(whole))) and not has_zero_response(structure, conditions)
    except (ArithmeticError, np.linalg.LinAlgError):
        return False
