"""An effect earns its name on runs that did not choose it; a law of another form does not."""

from dataclasses import replace

import numpy as np
import pytest

from rover_sweep.diagnosis.effects import every_form, form_named, forms_of, library
from rover_sweep.diagnosis.effects.steering_stiction import jumps, sticks
from rover_sweep.diagnosis.problem.least_squares import Fitted, fit
from rover_sweep.diagnosis.problem.residuals import Problem, problem
from rover_sweep.diagnosis.search.candidate_fits import Trial
from rover_sweep.diagnosis.search.confirm import Withheld, standard_errors, support_of
from rover_sweep.diagnosis.simulation.experiment import RATE, Experiment, in_order
from rover_sweep.diagnosis.simulation.simulator import Sensors, logged
from tests.diagnosis.planted import MODEL, NOISE, X, sweeps

FEW = tuple(c for c in MODEL.free if c.name in ("delay", "ln_C", "ln_Izz"))


def driven(law: str, size: float, plan, seed: int, steps: bool = False) -> list[Experiment]:
    """Runs of the model with one law at a size, with white noise: sweeps, or steps to both sides."""
    random = np.random.default_rng(seed)
    model = replace(MODEL, effects=(law,))
    key = form_named(law).key(form_named(law).parameters[0].name)
    out = []
    for run in sweeps(seed, plan):
        if steps:
            wave = np.sign(np.sin(2 * np.pi * run.t / 4.0)) * (np.abs(np.sin(2 * np.pi * run.t / 8.0)) > 0.5)
            run = replace(run, steer=run.amplitude * wave, commanded=None)
        clean = logged(run, model.structure, {**X, key: size}, Sensors.of(run))
        noisy = {c: y + 3.0 * NOISE[c] * random.standard_normal(y.size) for c, y in clean.items()}
        out.append(replace(run, measured=noisy))
    return out


def as_problem(runs: list[Experiment], seed: int) -> Problem:
    random = np.random.default_rng(seed)
    noise = [{c: 3.0 * s * random.standard_normal(run.t.size) for c, s in NOISE.items()} for run in runs]
    return problem(runs, noise)


class Base:
    """The part of a round that the judgement reads."""

    def __init__(self, found: Problem) -> None:
        self.problem = found
        self.fitted: Fitted = fit(found, MODEL.structure, FEW, X)
        self.closest = self.fitted

    def trial(self, law: str, start: float) -> Trial:
        model = replace(MODEL, effects=(law,))
        own = [c for c in model.free if c.name.startswith(form_named(law).id)]
        begin = {**X, own[0].name: start}
        whole = fit(self.problem, model.structure, (*FEW, *own), begin)
        return Trial(form_named(law).id, model, whole, self.fitted.cost - whole.cost)


@pytest.fixture(scope="module")
def stuck() -> tuple[Base, Withheld]:
    """Runs of a steering that sticks, and a held-out run of large steps, where a play would show."""
    used = driven("steering_stiction", 0.012, ((0.05, 2.2), (0.10, 2.2)), 1)
    held = driven("steering_stiction", 0.012, ((0.1, 2.2),), 2, steps=True)
    return Base(as_problem(used, 3)), Withheld((as_problem(held, 4),))


def test_the_true_law_gains_on_the_held_out_run_what_it_should(stuck: tuple[Base, Withheld]) -> None:
    base, held = stuck
    found = support_of(base.trial("steering_stiction", 0.012), base, held, 0.0)  # type: ignore[arg-type]
    assert found.against == ""
    assert found.held_out == pytest.approx(found.expected, rel=0.35)


def test_a_play_in_its_place_does_not_earn_its_name(stuck: tuple[Base, Withheld]) -> None:
    base, held = stuck
    trial = base.trial("steering_backlash", 0.005)
    assert trial.gain > 100.0  # it explains much of the runs that chose it
    found = support_of(trial, base, held, 0.0)  # type: ignore[arg-type]
    assert found.held_out is not None and found.held_out < 0.0
    assert "held-out" in found.against


def test_beside_a_far_larger_finding_a_small_gain_is_the_error_of_its_form(
    stuck: tuple[Base, Withheld],
) -> None:
    base, _ = stuck
    trial = base.trial("steering_stiction", 0.012)
    found = support_of(trial, base, Withheld(), 100.0 * trial.gain)  # type: ignore[arg-type]
    assert "form" in found.against


def test_a_size_that_cannot_be_told_from_none_is_no_finding() -> None:
    base = Base(as_problem(driven("roll_steer", 0.0, ((0.05, 2.2), (0.10, 2.2)), 5), 6))
    trial = base.trial("roll_steer", 0.01)
    assert abs(trial.fitted.x["roll_steer.e"]) < 2.0 * standard_errors(trial.fitted)["roll_steer.e"]
    assert support_of(trial, base, Withheld(), 0.0).against  # type: ignore[arg-type]


def test_forms_share_their_id_and_have_names_of_their_own() -> None:
    for effect in library():
        laws = forms_of(effect)
        assert laws[0].name == effect and len({law.name for law in laws}) == len(laws)
        assert all(form_named(law.name) is law and law.id == effect for law in laws)
    assert set(library()) < set(every_form())


def test_a_servo_that_sticks_goes_all_the_way() -> None:
    u = np.array([0.0, 0.01, 0.02, 0.03, 0.02, 0.01, 0.0])
    assert jumps(u, 0.015).tolist() == [0.0, 0.0, 0.02, 0.02, 0.02, 0.02, 0.0]
    assert sticks(u, 0.015).tolist() == [0.0, 0.0, 0.02, 0.03, 0.03, 0.01, 0.0]


def test_runs_of_one_clock_are_in_the_order_of_driving() -> None:
    one, two = sweeps(1, ((0.1, 2.0), (0.1, 2.0)))
    length = one.t.size / RATE
    early, late = replace(two, begin=10.0), replace(one, begin=20.0 + length)
    placed = in_order([late, early])
    assert [r.order for r in placed] == [1, 0] and placed[0].driven == pytest.approx(float(early.t[-1]))
    again = in_order([replace(late, begin=5.0), replace(early, begin=6.0)])  # after a restart: as given
    assert [r.order for r in again] == [0, 1]
