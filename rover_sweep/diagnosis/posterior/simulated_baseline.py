"""Which model a simulation follows: the simplest one that fits its recordings."""

from __future__ import annotations

from collections.abc import Sequence

from rover_sweep.data.geometry import Geometry
from rover_sweep.data.tolerances import Tolerances
from rover_sweep.diagnosis.posterior.model_fit import fit_with_floor
from rover_sweep.diagnosis.problem.least_squares import fit
from rover_sweep.diagnosis.problem.residuals import with_floor
from rover_sweep.diagnosis.settings import Baseline
from rover_sweep.diagnosis.simulation.candidates import Model
from rover_sweep.diagnosis.simulation.experiment import Experiment

LADDER: tuple[Baseline, ...] = ("kinematic", "bicycle", "roll-yaw")
EQUAL_COST = 1.3  # factor on the most complex model's cost, up to which a simpler model fits as well


def baseline_of(runs: Sequence[Experiment], rover: Geometry) -> Baseline:
    """The baseline of a simulation, with the noise floor of the most complex model's residual."""
    has_roll = bool(rover.sprung_mass and rover.h and rover.roll_inertia)
    ladder = LADDER if has_roll else LADDER[:-1]
    fullest, found = fit_with_floor(runs, Model(ladder[-1], rover, Tolerances()), {})
    problem = with_floor(runs, fullest.floor)
    for baseline in ladder[:-1]:
        model = Model(baseline, rover, Tolerances())
        start = {c.name: c.start for c in model.free}
        if fit(problem, model.structure, model.free, start).data_cost < EQUAL_COST * found.data_cost:
            return baseline
    return ladder[-1]
