"""Which models of a result have valid numbers, and why others are rejected."""

from __future__ import annotations

from collections.abc import Mapping

from rover_sweep.data.recording import LowPass, Recording
from rover_sweep.identification.fit import Estimate
from rover_sweep.identification.model_results import tyres_not_identifiable
from rover_sweep.identification.pipeline import Identification, ModelResult
from rover_sweep.quality.verdict import CoherenceVerdict

ORDER = ("kinematic", "bicycle", "roll-yaw", "lumped")
TITLES = {"kinematic": "Kinematic", "bicycle": "Bicycle", "roll-yaw": "Roll-yaw", "lumped": "Lumped"}


def ordered(result: Identification) -> dict[str, ModelResult]:
    """The models, ordered from simple to complex; a user's own structures last."""
    known = [n for n in ORDER if n in result.models]
    return {n: result.models[n] for n in [*known, *(n for n in result.models if n not in ORDER)]}


def rejection(result: Identification, name: str) -> str | None:
    """Why the free parameters of a model are not valid: the kinematic model suffices. None if they are valid.

    The fit still returns numbers in that case, but a stiffness that the data cannot distinguish from
    infinity is only fitted noise, and must not be shown as a result.
    """
    if name == "kinematic" or result.models[name].verdict.level != "not identifiable":
        return None
    return tyres_not_identifiable(result.models)


def usable(result: Identification) -> dict[str, ModelResult]:
    """The models with valid numbers, from simple to complex."""
    return {n: m for n, m in ordered(result).items() if rejection(result, n) is None}


def identified_runs(result: Identification) -> tuple[Recording, ...]:
    """The runs of all groups, used in the fit."""
    return tuple(run for group in result.groups for run in group.runs)


def judged_runs(result: Identification) -> tuple[tuple[Recording, CoherenceVerdict | None], ...]:
    """Each run of the groups with its verdict; runs of the same name get the verdicts in order."""
    left = list(result.coherence)
    out = []
    for run in identified_runs(result):
        verdict = next((v for v in left if v.run == run.name), None)
        if verdict:
            left.remove(verdict)
        out.append((run, verdict))
    return tuple(out)


def known_filters(result: Identification) -> Mapping[str, LowPass]:
    """The sensors' low-pass filters included in the models' outputs (of the first group)."""
    return result.groups[0].runs[0].filters


def inertia_of(model: ModelResult) -> Estimate | None:
    """The identified yaw inertia, None if the model has none or it was not free."""
    found = [e for e in model.fit.estimates if e.name == "Izz" and e.free]
    return found[0] if found else None
