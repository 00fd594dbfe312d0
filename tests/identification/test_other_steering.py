"""The lumped model holds for rovers that do not steer with the front wheels alone."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from synthetic import GEOMETRY, TRUE, driven

from rover_sweep.identification.grouping import Settings
from rover_sweep.identification.models import roll_yaw
from rover_sweep.identification.models import roll_yaw_matrices as matrices
from rover_sweep.identification.pipeline import identify
from rover_sweep.identification.state_space import Matrices, ModelStructure
from rover_sweep.identification.verify import verify
from rover_sweep.manoeuvre.sweep import Sweep

C, A, B = TRUE["C"], GEOMETRY.a, GEOMETRY.b
FORCES = {  # side force [N] and yaw moment [N m] per rad of the steering command
    "four-wheel steering": (C - 0.7 * C, A * C + B * 0.7 * C),
    "skid steering": (0.0, 8.0),
}


def steered_by(force: float, moment: float) -> ModelStructure:
    def build(p: Mapping[str, Any]) -> Matrices:
        return replace(matrices(p), g=np.array([force, moment, 0.0, 0.0]))

    return replace(roll_yaw(GEOMETRY).with_values(TRUE), build=build)


@pytest.mark.parametrize("kind", list(FORCES))
def test_the_lumped_model_is_recommended_and_predicts(kind: str) -> None:
    force, moment = FORCES[kind]
    rover = steered_by(force, moment)
    result = identify(
        [driven(rover, Sweep(amplitude=150), noise=0.01)], GEOMETRY, settings=Settings(models=("lumped",))
    )
    assert result.recommended == "lumped"
    lumped = result.models["lumped"].fit
    assert lumped.average < 5
    assert lumped["N_delta"].value == pytest.approx(moment / TRUE["Izz"], rel=0.1)
    other = driven(rover, Sweep(amplitude=140, w_min=0.5, w_max=15, t_rec=10), noise=0.01, seed=9)
    assert verify(lumped.structure, other).tic < 0.1
