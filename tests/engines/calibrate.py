"""`python -m tests.engines.calibrate DIR`: fit the hyperparameters of the posterior to drawn rovers.

DIR: where `python -m tests.engines --cache DIR` keeps its sets. Each set is explored once, and the evidence
for its explanations is kept in the same folder. The hyperparameters (FREE, in
`rover_sweep.diagnosis.posterior.weights`) are those with the largest mean log probability of the truth.
--but ENGINE leaves an engine out and prints the score on it.
"""

from __future__ import annotations

import argparse
import pickle
from collections.abc import Sequence
from dataclasses import dataclass
from math import log
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import minimize

from rover_sweep.data.vehicle_geometry import geometry_of, tolerances_of
from rover_sweep.diagnosis.posterior import weights
from rover_sweep.diagnosis.posterior.infer import Options, explore
from rover_sweep.diagnosis.posterior.weights import ExplanationEvidence, SomethingElse, posterior
from rover_sweep.diagnosis.simulation.candidates import Model
from rover_sweep.diagnosis.simulation.experiment import experiment, in_order
from rover_sweep.identification.grouping import Settings, grouped
from rover_sweep.identification.model_results import determined_model
from tests.engines.draw import BenchSet
from tests.foreign.grade import NEAREST, OUTSIDE, SAME

FREE = ("COARSE", "COARSE_HELD", "FIRST", "FURTHER", "ELSE", "POWER", "KEPT", "LEAST_GAIN")
POSITIVE = {"COARSE", "COARSE_HELD", "KEPT", "LEAST_GAIN", "POWER"}
LEAST = 3e-3  # probability of the truth that one set counts with at least, so that none decides alone
RIDGE = 0.004  # of the squared change of a hyperparameter, or of its logarithm


@dataclass(frozen=True)
class Known:
    """A set as the posterior sees it, with its truth. names: effect ids that are right or near."""

    engine: str
    hidden: frozenset[str]
    near: frozenset[str]
    evidence: tuple[ExplanationEvidence, ...]
    held_rows: int
    others: tuple[SomethingElse, ...]


def known(path: Path) -> Known:
    """The explored set of a cached one, kept in the same folder."""
    kept = path.with_suffix(".explored")
    if kept.exists():
        return pickle.loads(kept.read_bytes())  # type: ignore[no-any-return]
    drawn: BenchSet = pickle.loads(path.read_bytes())
    assert drawn.runs.vehicle is not None
    rover = geometry_of(drawn.runs.vehicle)
    every = in_order([experiment(run) for run in (*drawn.runs, *drawn.held_out)])
    used, held = every[: len(drawn.runs)], every[len(drawn.runs) :]
    baseline = determined_model(grouped(drawn.runs, Settings()), rover)[0]
    model = Model(baseline, rover, tolerances_of(drawn.runs.vehicle))
    found = explore(used, model, {}, Options((), (), lambda what, share: None, lambda: False), held)
    inside = frozenset(e for e in drawn.hidden if not e.startswith(OUTSIDE))
    near = frozenset(n for e in drawn.hidden for n in NEAREST.get(e, ()))
    one = Known(drawn.engine, inside, near, found.evidence, found.held_rows, found.others)
    kept.write_bytes(pickle.dumps(one))
    return one


def probability(one: Known) -> float:
    """Of the truth: exactly the hidden effects, or nothing wrong where none of the list is hidden."""
    total = 0.0
    for w in posterior(one.evidence, one.held_rows, one.others).weighed:
        right = [e for e in w.matters if one.hidden & {e, *SAME.get(e, ())}]
        wrong = [e for e in w.matters if e not in right and e not in one.near]
        found = {h for h in one.hidden if any(h == e or e in SAME.get(h, ()) for e in right)}
        share = float(np.prod([1.0 - w.matters[e] if w.unnamed else 0.0 for e in wrong]))
        if found == one.hidden:
            total += w.probability * share * float(np.prod([w.matters[e] for e in right]))
    return total


def score(found: Sequence[Known]) -> float:
    """Mean log probability of the truth."""
    return sum(log(max(probability(one), LEAST)) for one in found) / len(found)


def fitted(found: Sequence[Known]) -> dict[str, float]:
    """{hyperparameter: value}; the module keeps them."""
    start = [_coordinate(name, getattr(weights, name)) for name in FREE]

    def loss(x: Any) -> float:
        for name, value in zip(FREE, x, strict=True):
            setattr(weights, name, float(np.exp(value)) if name in POSITIVE else float(value))
        return -score(found) + RIDGE * float(np.sum((x - np.array(start)) ** 2))

    best = minimize(loss, start, method="Nelder-Mead", options={"maxiter": 600, "xatol": 0.03, "fatol": 2e-4})
    loss(best.x)
    return {name: round(getattr(weights, name), 2) for name in FREE}


def _coordinate(name: str, value: float) -> float:
    return log(value) if name in POSITIVE else value


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.engines.calibrate", description=__doc__)
    parser.add_argument("directory", type=Path)
    parser.add_argument("--sets", type=int, default=1000, help="most sets that are used")
    parser.add_argument("--but", default="", metavar="ENGINE", help="leave an engine out and score it")
    args = parser.parse_args()
    found = [known(path) for path in sorted(args.directory.glob("*.pickle"))[: args.sets]]
    used = [one for one in found if one.engine != args.but]
    print(f"{len(used)} sets, mean log score {score(used):.3f} now", flush=True)
    print(fitted(used), f"mean log score {score(used):.3f}")
    if args.but:
        print(f"{args.but}: {score([one for one in found if one.engine == args.but]):.3f}")


if __name__ == "__main__":
    main()
