"""A law outside the list: its place, its curve and its worth on a run that did not choose it."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from planted import MODEL, NOISE, X, shortened, sweeps
from scipy.signal import firwin

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.posterior.model_fit import ModelFit, added_rows, tapered_spectrum, transfers
from rover_sweep.diagnosis.posterior.unnamed import groups, unit_spectra
from rover_sweep.diagnosis.problem.least_squares import fit
from rover_sweep.diagnosis.problem.residuals import problem
from rover_sweep.diagnosis.result import Unknown
from rover_sweep.diagnosis.simulation.experiment import RATE, Experiment
from rover_sweep.diagnosis.simulation.simulator import logged, motion
from rover_sweep.diagnosis.simulation.table_law import TableLaw, refuse_law, resonator, with_laws
from rover_sweep.diagnosis.unexplained import NO_LAW, find_laws, input_places, with_laws_of

DAMPING = TableLaw("yaw moment", "r", (-1.4, -0.7, 0.0, 0.7, 1.4), (0.4, 0.1, 0.0, -0.1, -0.4))
BENT_GYRO = TableLaw("sensor of r", "signal", (-2.0, 0.0, 2.0), (0.1, 0.0, 0.1))
BENT_LINKAGE = TableLaw("steering", "delta", (-0.2, -0.1, 0.1, 0.2), (0.02, 0.0, 0.0, -0.02))


def with_law(*laws: TableLaw) -> tuple[list[Experiment], list[dict[str, Array]]]:
    """Shortened sweeps of the model with the laws, with noise: (runs, their noise)."""
    random = np.random.default_rng(3)
    runs, noise = [], []
    for run in map(shortened, sweeps(((0.2, 2.2), (0.12, 1.6), (0.15, 2.0)))):
        mess = {c: s * random.standard_normal(run.t.size) for c, s in NOISE.items()}
        true = logged(run, with_laws(MODEL, laws), X)
        runs.append(replace(run, measured={c: y + mess[c] for c, y in true.items()}))
        noise.append(mess)
    return runs, noise


def last_of(runs: list[Experiment], noise: list[dict[str, Array]]) -> ModelFit:
    used = problem(runs, noise)
    base = fit(used, MODEL, X)
    return ModelFit(used, base, base, {})


@cache
def quiet() -> ModelFit:
    """One run in which only noise is left."""
    runs, noise = with_law()
    return last_of(runs[:1], noise[:1])


def test_the_unknown_says_place_curve_worth_and_next_run() -> None:
    runs, noise = with_law(BENT_GYRO)
    held: Any = SimpleNamespace(run=SimpleNamespace(name="run3"), problem=problem(runs[2:], noise[2:]))
    unnamed = Unknown("r", "r", 2.0, "r differs; nothing predicts it")
    found, laws = with_laws_of(unnamed, last_of(runs[:2], noise[:2]), (held,))
    assert laws and found.place == "sensor of r" and len(found.curves) == 1
    curve, at = found.curves[0], np.array(found.curves[0].x)
    assert curve.over == "signal" and curve.over_unit == curve.unit == "rad/s"
    inside = np.abs(at) > 0.3
    assert np.allclose(np.array(curve.y)[inside], 0.05 * np.abs(at[inside]), rtol=0.5)
    assert all(low <= y <= high for low, y, high in zip(curve.low, curve.y, curve.high, strict=True))
    assert found.could_be in found.sentence and found.next_run in found.sentence
    assert "% of the held-out residual" in found.sentence
    (judged,) = found.held_out
    assert judged.after < judged.before and judged.run == "run3"


def test_without_a_law_the_unknown_says_so() -> None:
    found, laws = with_laws_of(Unknown("r", "r", 2.0, "r differs"), quiet(), ())
    assert laws is None and NO_LAW in found.sentence and not found.curves and not found.place


@pytest.mark.parametrize(("place", "size"), [("sensor of ay", 0.6), ("steering", 0.02), ("yaw moment", 0.5)])
def test_the_place_of_an_input_without_a_law_is_found(place: str, size: float) -> None:
    """Noise of 1 to 4 Hz that depends on nothing is added at a place."""
    used, base = quiet().problem, quiet().fitted
    found = transfers(used.runs, base.model, base.x)
    random = np.random.default_rng(2).standard_normal(used.runs[0].t.size)
    low_pass = firwin(401, [1.0, 4.0], pass_zero=False, fs=RATE)
    s = size * np.convolve(random, low_pass, "same")
    added = added_rows(used, found, place, [tapered_spectrum(used.runs[0], s)])
    likely = input_places(used, found, base.rows + 4.0 * added)
    assert likely and place in likely[:2]
    assert input_places(used, found, base.rows) == ()


@pytest.mark.parametrize("baseline", ["kinematic", "bicycle", "lumped"])
def test_every_baseline_has_candidates_at_the_places_that_it_has(baseline: str) -> None:
    other = replace(MODEL, baseline=baseline)
    found = transfers(quiet().problem.runs, other, {c.name: c.start for c in other.free})
    places = {law.place for law in groups(found)}
    assert {"steering", "sensor of r"} <= places
    assert ("yaw moment" in places) == (baseline == "bicycle") and "roll moment" not in places


def test_rows_of_a_law_are_those_of_the_simulation() -> None:
    """The impulse responses give the same rows as a simulation with a small law."""
    one = quiet().problem
    found = transfers(one.runs, MODEL, X)
    for law in (DAMPING, BENT_LINKAGE, BENT_GYRO):
        small = replace(law, y=tuple(0.01 * y for y in law.y))
        want = one.model(with_laws(MODEL, (small,)), X) - one.model(MODEL, X)
        rows = [added_rows(one, found, law.place, s) for s in unit_spectra(small, found)]
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


def test_a_pendulum_is_found_as_a_resonance_with_its_frequency() -> None:
    """A hidden resonator that a_y drives pushes the body; its law is found and holds on another run."""
    runs, noise = with_law(replace(resonator("side force", "a_y", 1.4, 0.1), y=(0.3, 0.0)))
    found = find_laws(last_of(runs[:2], noise[:2]), {"run3": problem(runs[2:], noise[2:])})
    assert found is not None and found.holds
    assert found.share_removed is not None and found.share_removed > 0.7
    first = found.laws[0].at(found.fitted.x)
    assert first.memory == "resonance" and first.size == pytest.approx(1.4, rel=0.1)


def test_a_stop_stiffer_than_the_spring_does_not_diverge() -> None:
    """A law inside the loop is part of each step; fixed-point passes over whole runs diverge here."""
    run = quiet().problem.runs[0]
    stop = TableLaw("roll moment", "phi", (-0.2, -0.015, 0.015, 0.2), (60.0, 0.0, 0.0, -60.0))
    free, stopped = (motion(run, with_laws(MODEL, laws), X)["phi"] for laws in ((), (stop,)))
    assert np.max(np.abs(stopped)) < 0.8 * np.max(np.abs(free))
