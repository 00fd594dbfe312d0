"""The forms of effects in the words and units of a variant file."""

from __future__ import annotations

from collections.abc import Mapping

from rover_sweep.diagnosis.effects import Effect
from rover_sweep.diagnosis.simulation.augmented import AugmentedModel

Value = float | str | tuple[float, float, float]
AS_FIRST = {"from then on", "one run"}  # changes of ground that the simulated rover has as its first form
LEAST_SHAPE = 1e-3  # of a second-order servo


def in_plant_units(model: AugmentedModel, effect: Effect, values: Mapping[str, Value]) -> dict[str, Value]:
    """The parameters of an effect as the simulated rover has them, and the form if it is not the first."""
    out, numbers = dict(values), model.numbers
    if effect.id == "steering_compliance":
        out = {"k": numbers["compliance"]}
    elif effect.id == "yaw_damping":
        out = {"c": numbers["yaw_damp"] + numbers["yaw_damp_v"]}
    elif effect.name == "servo_lag/second order":
        out |= {"q": max(model.value("lag_shape"), LEAST_SHAPE)}
    elif effect.name == "surface_change/one run":
        out |= {"t": 0.0}
    if out and not effect.first and effect.form not in AS_FIRST:
        out |= {"form": effect.form}
    return out


def forms_not_in_the_plant(model: AugmentedModel) -> list[str]:
    """Sentences on forms that the simulated rover has otherwise."""
    names = {effect.name for effect in model.added}
    said = {
        "surface_change": "the ground stays changed after that run, in the model only until its end",
        "surface_change/one run": "the ground stays changed after that run, in the model only during it",
        "surface_change/all along": "the grip drifts on at standstill, in the model only while driving",
    }
    return [words for name, words in said.items() if name in names]
