"""A law outside the list: its place, its curve and its worth on a run that did not choose it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.problem.least_squares import Fitted, fit, sensitivities
from rover_sweep.diagnosis.problem.residuals import Problem, problem
from rover_sweep.diagnosis.simulation.experiment import RATE, Experiment, tapered
from rover_sweep.diagnosis.simulation.simulator import Sensors, logged
from rover_sweep.diagnosis.simulation.table_law import TableLaw, refuse_law, with_laws
from rover_sweep.diagnosis.unexplained.groups import hats
from rover_sweep.diagnosis.unexplained.law_search import find_laws
from rover_sweep.diagnosis.unexplained.transfers import added_rows, transfers
from tests.diagnosis.planted import MODEL, NOISE, X, sweeps

DAMPING = TableLaw("yaw moment", "r", (-1.4, -0.7, 0.0, 0.7, 1.4), (0.4, 0.1, 0.0, -0.1, -0.4))
LAWS = {
    "yaw moment": DAMPING,
    "steering": TableLaw("steering", "delta", (-0.2, -0.1, 0.1, 0.2), (0.02, 0.0, 0.0, -0.02)),
    "sensor of r": TableLaw("sensor of r", "signal", (-2.0, 0.0, 2.0), (0.1, 0.0, 0.1)),
}
PART = slice(3000, 8400)  # 27 s in the middle of the sweep


def _shortened(run: Experiment) -> Experiment:
    """The middle of a sweep."""
    t = run.t[PART] - run.t[PART][0]
    return replace(
        run,
        t=t,
        steer=run.steer[PART],
        speed=run.speed[PART],
        heading=run.heading[PART],
        taper=tapered(t.size),
    )


def _with_law(law: TableLaw, seed: int) -> tuple[list[Experiment], list[dict[str, Array]]]:
    """Shortened sweeps of the model with the law, with noise: (runs, their noise)."""
    random = np.random.default_rng(seed)
    runs, noise = [], []
    for run in map(_shortened, sweeps(seed, ((0.2, 2.2), (0.12, 1.6), (0.15, 2.0)))):
        mess = {c: s * random.standard_normal(run.t.size) for c, s in NOISE.items()}
        true = logged(run, with_laws(MODEL.structure, (law,)), X, Sensors.of(run))
        runs.append(replace(run, measured={c: y + mess[c] for c, y in true.items()}))
        noise.append(mess)
    return runs, noise


def _fitted(runs: list[Experiment], noise: list[dict[str, Array]]) -> tuple[Problem, Fitted]:
    found = problem(runs, noise)
    return found, sensitivities(found, fit(found, MODEL.structure, MODEL.free, X, steps=4))


@pytest.mark.parametrize("name", ["steering", "sensor of r"])
def test_the_place_of_a_planted_law_is_found_and_holds_on_another_run(name: str) -> None:
    runs, noise = _with_law(LAWS[name], 3)
    used, base = _fitted(runs[:2], noise[:2])
    found = find_laws(used, base, {"run3": problem(runs[2:], noise[2:])})
    assert found is not None and found.holds
    first = found.laws[0]
    assert name in (first.law.place, *first.alternatives)
    assert found.share_removed is not None and found.share_removed > 0.7


def test_nothing_is_found_where_only_noise_is_left() -> None:
    runs, noise = _with_law(replace(DAMPING, y=(0.0,) * 5), 5)
    used, base = _fitted(runs[:1], noise[:1])
    assert find_laws(used, base, {}) is None


def test_rows_of_a_law_are_those_of_the_simulation() -> None:
    """The impulse responses give the same rows as a simulation with a small law."""
    runs, noise = _with_law(replace(DAMPING, y=(0.0,) * 5), 5)
    one = problem(runs[:1], noise[:1])
    found = transfers(one.runs, MODEL.structure, X)
    for law in LAWS.values():
        small = replace(law, y=tuple(0.01 * y for y in law.y))
        want = one.model(with_laws(MODEL.structure, (small,)), X) - one.model(MODEL.structure, X)
        rows = [added_rows(one, found, law.place, s) for s in hats(small, found)]
        got = np.column_stack(rows) @ np.array(small.y)
        assert np.linalg.norm(got - want) < 0.1 * np.linalg.norm(want), law.place


@pytest.mark.parametrize(
    "change",
    [
        {"place": "wheel"},
        {"over": "colour"},
        {"times": "phi"},
        {"x": (0.0, 0.0, 1.0, 2.0, 3.0)},
        {"y": (0.0, np.nan, 1.0, 1.0, 1.0)},
        {"y": (0.0, 1.0)},
        {"memory": "play"},
        {"over": "signal"},
        {"place": "steering"},
    ],
)
def test_a_table_that_cannot_be_simulated_is_refused(change: dict[str, object]) -> None:
    with pytest.raises(ValueError, match=r"law|place"):
        refuse_law(replace(DAMPING, **change))  # type: ignore[arg-type]


def test_a_law_with_play_has_a_memory() -> None:
    t = np.arange(400) / RATE
    steer = 0.2 * np.sin(2 * np.pi * t)
    from rover_sweep.diagnosis.simulation.table_law import behind_play

    out = behind_play(steer, 0.05)
    assert np.max(np.abs(out)) == pytest.approx(0.15, abs=1e-3)
    assert np.max(np.abs(steer - out)) == pytest.approx(0.05, abs=1e-9)
