"""Effects in which simulation and recordings differ, though no diagnosis named them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from rover_sweep.comparison.common_model import FittedSide, side_of
from rover_sweep.comparison.differences import ALIKE
from rover_sweep.comparison.hidden import suspects
from rover_sweep.diagnosis.effects import form_named
from rover_sweep.diagnosis.search.candidate_fits import screen, tangent
from rover_sweep.diagnosis.simulation.candidates import Model
from rover_sweep.diagnosis.simulation.experiment import Experiment

MOST = 2  # effects that are added


@dataclass(frozen=True, eq=False)
class Suspected:
    """Both sides with the added effects. alike: {added effect: others that explain nearly as much}."""

    recordings: FittedSide
    simulation: FittedSide
    alike: Mapping[str, tuple[str, ...]]


def with_suspects(
    recorded: Sequence[Experiment],
    recordings: FittedSide,
    simulation: FittedSide,
    fitted: dict[tuple[str, ...], FittedSide],
) -> Suspected:
    """Both sides with the effects added in which they differ clearly; of several the one that fits best.

    recorded: the recorded runs. fitted: {laws and run: the recordings fitted with them}, used and filled.
    """
    alike: dict[str, tuple[str, ...]] = {}
    for _ in range(MOST):
        tried: dict[str, tuple[FittedSide, FittedSide]] = {}
        for name in suspects(recordings, simulation):
            model = recordings.model.with_effect(name)
            if model.laws_and_run not in fitted:
                fitted[model.laws_and_run] = _with(recorded, recordings, name, model)
            sides = fitted[model.laws_and_run], _with(simulation.plain.runs, simulation, name, model)
            if not any(side.at_largest(name) for side in sides):
                tried[name] = sides
        if not tried:
            break
        before = _cost(recordings, simulation)
        gains = {name: before - _cost(*sides) for name, sides in tried.items()}
        best = max(gains, key=lambda name: gains[name])
        alike[best] = tuple(n for n, gain in gains.items() if n != best and gain > ALIKE * gains[best])
        recordings, simulation = tried[best]
    return Suspected(recordings, simulation, alike)


def _cost(one: FittedSide, two: FittedSide) -> float:
    return one.fitted.cost + two.fitted.cost


def _with(runs: Sequence[Experiment], side: FittedSide, name: str, model: Model) -> FittedSide:
    """The side fitted with the effect, from what a linear prediction says, where it says something."""
    found = screen(side.problem, side.fitted, tangent(side.fitted), side.model, form_named(name))
    return side_of(runs, model, {**side.fitted.x, **(found.start if found else {})}, model.ids)
