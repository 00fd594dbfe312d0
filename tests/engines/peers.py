"""`python -m tests.engines.peers`: two general methods on the sets of the bench, to compare with its answers.

Both learn the residual of a fitted baseline in yaw and lateral acceleration from the used runs, and predict
that of the held-out run. pysindy: sparse regression (STLSQ) on a library of terms, in the discrepancy form of
Kaheman et al. 2019; its threshold is the largest with which each used run is predicted well from the others.
The largest term of each equation is read as an effect (`peer_terms`). scikit-learn: a Gaussian process over
delta, delta', r, a_y and V, which names nothing.
"""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pysindy
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

from rover_sweep.data.recording import Array
from tests.engines.draw import KINDS, drawn_set
from tests.engines.engine import MODULES, engine
from tests.engines.judge import HALVED, share
from tests.engines.peer_residuals import EQUATIONS, Discrepancy, discrepancies
from tests.engines.peer_terms import READ, terms
from tests.foreign.grade import grade

THRESHOLDS = tuple(np.geomspace(0.02, 1.5, 13))  # rms of a term over that of the residual
RIDGE = 1e-2  # of the number of samples
KEPT = 0.9  # of what the best threshold explains: the sparsest model that explains that much is taken
POINTS = 400  # that a Gaussian process learns from
INPUTS = ("delta", "delta'", "r", "a_y", "V")
EXPLAINABLE = 1.5  # power over that of the noise, above which a share removed is computed
LEAST = 0.1  # of the power beyond the noise: less explains nothing


@dataclass(frozen=True)
class PeerAnswer:
    """names: effects that are read, in the order of their equations; said: the terms.

    removed: share of the held-out residual beyond the noise, None where there is nothing to explain.
    """

    names: tuple[str, ...]
    said: tuple[str, ...]
    removed: float | None


def sparse(used: Sequence[Discrepancy], held: Sequence[Discrepancy]) -> PeerAnswer:
    """pysindy's answer."""
    library = [terms(one.signals) for one in (*used, *held)]
    labels = tuple(library[0])
    columns = [np.column_stack([one[name] for name in labels]) for one in library]
    scale = np.sqrt(np.mean(np.vstack(columns[: len(used)]) ** 2, axis=0)) + 1e-12
    columns = [one / scale for one in columns]
    names, said, left = [], [], []
    for equation in EQUATIONS:
        ys = [one.left[equation] / one.noise[equation] for one in (*used, *held)]
        found = _chosen(columns[: len(used)], ys[: len(used)])
        left.append([y - x @ found for x, y in zip(columns[len(used) :], ys[len(used) :], strict=True)])
        if np.any(found):
            largest = int(np.argmax(np.abs(found)))
            said.append(f"{equation}: {found[largest]:+.2f} {labels[largest]}")
            names.append(READ[equation][labels[largest]])
    return PeerAnswer(tuple(dict.fromkeys(filter(None, names))), tuple(said), _removed(held, left))


def _chosen(xs: Sequence[Array], ys: Sequence[Array]) -> Array:
    """Coefficients (terms,) with the threshold that predicts runs it has not seen; 0 where none explains."""
    costs, samples = [float(sum(np.sum(y**2) for y in ys))], sum(y.size for y in ys)
    thresholds = np.array(THRESHOLDS) * np.sqrt(costs[0] / samples)
    for threshold in thresholds:
        cost = 0.0
        for k in range(len(xs)):
            rest = [j for j in range(len(xs)) if j != k]
            found = _stlsq([xs[j] for j in rest], [ys[j] for j in rest], threshold)
            cost += float(np.sum((ys[k] - xs[k] @ found) ** 2))
        costs.append(cost)
    explained = costs[0] - np.array(costs[1:])
    beyond = costs[0] - samples  # the noise
    if np.max(explained) < LEAST * beyond or costs[0] < EXPLAINABLE * samples:
        return np.zeros(xs[0].shape[1])
    enough = np.flatnonzero(explained >= KEPT * np.max(explained))
    return _stlsq(xs, ys, float(thresholds[enough[-1]]))


def _stlsq(xs: Sequence[Array], ys: Sequence[Array], threshold: float) -> Array:
    x, y = np.vstack(xs), np.concatenate(ys)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that a threshold removes every term
        model = pysindy.SINDy(
            optimizer=pysindy.STLSQ(threshold=threshold, alpha=RIDGE * y.size),
            feature_library=pysindy.IdentityLibrary(),
        )
        model.fit(x, t=1.0, x_dot=np.column_stack([y] * x.shape[1]))
    return np.asarray(model.coefficients())[0]


def gaussian(used: Sequence[Discrepancy], held: Sequence[Discrepancy]) -> PeerAnswer:
    """The Gaussian process's answer."""
    x = np.vstack([_inputs(one) for one in used])
    middle, width = np.mean(x, axis=0), np.std(x, axis=0) + 1e-9
    chosen = np.linspace(0, len(x) - 1, min(POINTS, len(x))).astype(int)
    left = []
    for equation in EQUATIONS:
        y = np.concatenate([one.left[equation] / one.noise[equation] for one in used])
        kernel = ConstantKernel(1.0, (1e-3, 1e4)) * RBF(np.ones(len(INPUTS)), (0.05, 1e3))
        process = GaussianProcessRegressor(kernel + WhiteKernel(1.0, (0.05, 1e3)))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # that a length is at its bound: an input that does not matter
            process.fit(((x - middle) / width)[chosen], y[chosen])
        left.append(
            [
                one.left[equation] / one.noise[equation] - process.predict((_inputs(one) - middle) / width)
                for one in held
            ]
        )
    return PeerAnswer((), (), _removed(held, left))


def _inputs(one: Discrepancy) -> Array:
    return np.column_stack([one.signals[name] for name in INPUTS])


def _removed(held: Sequence[Discrepancy], left: Sequence[Sequence[Array]]) -> float | None:
    """Share of the power beyond that of the noise, both equations together."""
    before = sum(float(np.sum((d.left[e] / d.noise[e]) ** 2)) for e in EQUATIONS for d in held)
    samples = sum(y.size for ys in left for y in ys)
    after = sum(float(np.sum(y**2)) for ys in left for y in ys)
    return (before - after) / (before - samples) if before > EXPLAINABLE * samples else None


def main() -> None:
    args = _arguments()
    names = tuple(MODULES) if args.engine == "all" else (args.engine,)
    seeds = range(args.seed, args.seed + args.sets)
    for kind in tuple(KINDS) if args.kind == "all" else (args.kind,):
        found = [_compared(name, kind, seed, args.cache) for name in names for seed in seeds]
        print(summary(kind, found), flush=True)


@dataclass(frozen=True)
class Compared:
    """One set: effects that pysindy named rightly and wrongly, and the shares that both peers removed."""

    right: int
    wrong: int
    sparse: float | None
    gaussian: float | None


def _compared(name: str, kind: str, seed: int, cache: Path | None) -> Compared:
    drawn = drawn_set(name, kind, seed, cache)
    used, held = discrepancies(drawn)
    one, other = sparse(used, held), gaussian(used, held)
    answer = {"verdict": "", "findings": [{"effect": effect} for effect in one.names], "seconds": 0.0}
    marks = grade(str(seed), kind, drawn.hidden, answer, engine(name).places)
    shares = " ".join("-" if s is None else f"{s:.2f}" for s in (one.removed, other.removed))
    truth, said = ", ".join(drawn.hidden) or "none", "; ".join(one.said) or "-"
    print(f"{name} {kind} {seed} {marks.mark}: {truth} | {said} | removed {shares}", flush=True)
    return Compared(len(marks.first), len(marks.wrong), one.removed, other.removed)


def summary(kind: str, found: Sequence[Compared]) -> str:
    """A line for a kind of set."""
    halved = (
        share([x >= HALVED for x in some if x is not None])
        for some in ([one.sparse for one in found], [one.gaussian for one in found])
    )
    right, wrong = sum(one.right for one in found), sum(one.wrong for one in found)
    return (
        f"{kind}: {len(found)} sets, pysindy named {right} of {KINDS[kind] * len(found)} rightly and {wrong} "
        f"wrongly, in {share([one.wrong > 0 for one in found])} sets; halved the held-out residual: "
        "pysindy {}, Gaussian process {}".format(*halved)
    )


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tests.engines.peers", description=__doc__)
    parser.add_argument("--engine", choices=[*MODULES, "all"], default="all", help="default all")
    parser.add_argument("--kind", choices=[*KINDS, "all"], default="all", help="kind of set (default all)")
    parser.add_argument("--sets", type=int, default=5, help="sets of each kind (default 5)")
    parser.add_argument("--seed", type=int, default=1, help="of the first set; the others follow (default 1)")
    parser.add_argument("--cache", type=Path, metavar="DIR", help="drawn sets")
    return parser.parse_args()


if __name__ == "__main__":
    main()
