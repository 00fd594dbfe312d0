"""Places where recordings of the real firmware differ from a roll-yaw model, against their known truth."""

from __future__ import annotations

from pathlib import Path

from rover_sweep.api.read import Reading, load_steered
from rover_sweep.data.geometry import Tolerances
from rover_sweep.data.vehicle_file import load as vehicle_of
from rover_sweep.data.vehicle_geometry import geometry_of
from rover_sweep.diagnosis.locate import mismatches
from rover_sweep.diagnosis.posterior.model_fit import fit_with_floor
from rover_sweep.diagnosis.result import Mismatch
from rover_sweep.diagnosis.simulation.candidates import Model
from rover_sweep.diagnosis.simulation.experiment import experiment

SETS = Path(__file__).parents[1] / "data" / "concealed-ardurover"


def located(name: str) -> dict[tuple[str, str], Mismatch]:
    """{(channel, condition): place} of three runs of a set against the nominal model fitted to them."""
    vehicle = vehicle_of(SETS / name / "rover.toml")
    files = tuple(str(SETS / name / f"run{k}.BIN") for k in (1, 2, 3))
    runs = [experiment(run) for run in load_steered(files, vehicle, Reading(None, {}), [])]
    model = Model("roll-yaw", geometry_of(vehicle), Tolerances())
    problem, fitted = fit_with_floor(runs, model, {})
    found = mismatches(problem, problem.measured - problem.model(model, fitted.x))
    return {(m.channel, m.condition): m for m in found}


def test_backlash_is_a_third_harmonic_that_hardly_grows() -> None:
    found = located("f")
    assert found["r", "3rd harmonic"].residual_over_noise > 3
    assert ("r", "hardly grows with amplitude") in found
    assert not any(m.condition == "steady" for m in found.values())


def test_a_steering_trim_is_steady_and_a_rate_limit_shows_at_the_top() -> None:
    found = located("d")
    assert max(found.values(), key=lambda m: m.residual_over_noise).condition == "steady"
    assert found["r", "throughout"].band[0] > 10 and ("r", "3rd harmonic") in found
