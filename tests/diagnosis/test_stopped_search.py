"""A search that is stopped ends at the next simulation and keeps what it has."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rover_sweep.diagnosis.posterior.infer import Options, infer
from rover_sweep.diagnosis.posterior.model_fit import fit_with_floor
from rover_sweep.diagnosis.problem.residuals import Problem, Stopped, never
from rover_sweep.diagnosis.simulation.simulator import logged
from tests.diagnosis.planted import MODEL, NOISE, X, sweeps

ONLY = ("steering_trim", "transport_delay")
LATE = {**X, "delay": 0.16}


def _runs() -> list:
    random = np.random.default_rng(1)
    model = MODEL.with_effect("transport_delay")
    return [
        replace(
            run,
            measured={
                c: y + NOISE[c] * random.standard_normal(y.size) for c, y in logged(run, model, LATE).items()
            },
        )
        for run in sweeps(1, ((0.1, 2.2),))
    ]


class Counted:
    """Stops after some questions, and counts those that come later."""

    def __init__(self, after: int) -> None:
        self.after, self.asked = after, 0

    def __call__(self) -> bool:
        self.asked += 1
        return self.asked > self.after


def test_a_simulation_after_the_stop_raises() -> None:
    problem, fitted = fit_with_floor(_runs(), MODEL, X, near=True)
    stopped = replace(problem, stop=lambda: True)
    with pytest.raises(Stopped):
        stopped.model(fitted.model, fitted.x)


@pytest.mark.parametrize("after", [0, 3, 25, 60])
def test_the_answer_so_far_can_be_simulated(after: int) -> None:
    found = infer(_runs(), MODEL, X, Options(ONLY, (), lambda what, share: None, Counted(after)))
    assert found.stopped
    for part in (found.none, found.last):
        assert isinstance(part.problem, Problem)
        assert part.problem.model(part.model, part.fitted.x).shape == (part.problem.size,)
    for one in found.named:
        assert one.law.id in found.last.model.ids


def test_without_a_stop_the_effect_is_named_and_the_share_done_grows() -> None:
    shares: list[float] = []
    found = infer(_runs(), MODEL, X, Options(ONLY, (), lambda what, share: shares.append(share), never))
    assert [n.law.id for n in found.named] == ["transport_delay"]
    assert not found.stopped
    assert shares == sorted(shares)
    assert shares[0] == 0.0 and 0.6 < shares[-1] <= 0.92
