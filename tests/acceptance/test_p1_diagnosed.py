"""The Stanford P1 car: what the plain a_y = v' + V r leaves out is named by `diagnose` from the sweep alone.

CIFER's a_y row comes out at J = 173 with the plain equation and at 44 with an accelerometer 1.05 ft above the
point of v (test_p1). Here only a vehicle file is given, with the accelerometer at that point; all
effects are candidates, and the second file is held out. That file cannot show the finding: it hardly excites
x r' - z p', and its a_y/r of 13-20 ft/s belongs to no speed that its r/delta allows.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from p1_tables import tables

import rover_sweep as rs
from rover_sweep.diagnosis.held_out.cost import frequency_responses_of, response_costs
from rover_sweep.diagnosis.problem.residuals import centred
from rover_sweep.diagnosis.simulation.experiment import experiment

MAPS = Path(__file__).parents[1] / "data" / "cars"
FOOT = 0.3048


@pytest.fixture(scope="module")
def runs(foreign_recordings: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[rs.Runs, rs.Runs]:
    """The sweep, and the file to hold out."""
    files = tables(foreign_recordings / "p1", tmp_path_factory.mktemp("p1"))
    vehicle, columns = (MAPS / f"stanford_p1.{kind}.toml" for kind in ("vehicle", "columns"))
    sweep, fresh = (rs.read(file, vehicle=vehicle, columns=columns) for file in files)
    return sweep, fresh


@pytest.fixture(scope="module")
def found(runs: tuple[rs.Runs, rs.Runs]) -> rs.FullDiagnosis:
    return rs.diagnose(runs[0], runs[1])


@pytest.mark.xfail(reason="at 100 Hz roll steer of the rear axle takes the place of its height")
def test_the_place_of_the_accelerometer_is_named(found: rs.FullDiagnosis) -> None:
    named = {f.effect: {v.name: v for v in f.parameters} for f in found.findings}
    z = named["imu_offset"]["z"]
    assert z.low is not None and z.low > -0.03  # the sweep alone hardly tells it from a wide track
    # a fit of CIFER's own model has it 1.05 ft above the point of v, which is not quite the roll axis
    assert 0.4 * 1.05 * FOOT < z.value < 1.5 * 1.05 * FOOT


def test_so_is_the_tyres_relaxation_length(found: rs.FullDiagnosis) -> None:
    """A car's is about a wheel's radius; with it the yaw inertia comes near m a b."""
    named = {f.effect: {v.name: v for v in f.parameters} for f in found.findings}
    assert 0.2 < named["tyre_relaxation"]["sigma"].value < 0.5
    izz = next(f for f in found.falsified if f.name == "Izz")
    usual = 1724 * 1.35 * 1.15  # m a b
    assert abs(np.log(izz.after / usual)) < min(np.log(2.1), abs(np.log(izz.before / usual)))


def test_what_is_left_is_told_without_the_tyres_candidate(runs: tuple[rs.Runs, rs.Runs]) -> None:
    """Of one run, too: what the relaxation length would explain must not pass as explained."""
    found = rs.diagnose(runs[0], runs[1], only=("imu_offset", "steering_trim"))
    assert [f.effect for f in found.findings] == ["imu_offset"]
    assert found.verdict == "partly explained"
    assert found.unknown is not None and found.unknown.residual_over_noise > 1.2


@pytest.mark.xfail(reason="at 100 Hz roll steer of the rear axle takes the place of its height")
def test_the_cost_of_a_y_falls_with_this_number_alone(
    found: rs.FullDiagnosis, runs: tuple[rs.Runs, rs.Runs]
) -> None:
    """As test_p1 does with CIFER's model: all else kept, the offset taken out and put back."""
    assert found.model is not None
    plain = replace(found.model, x={**found.model.x, "imu_x": 0.0, "imu_z": 0.0})
    run = experiment(runs[0][0])
    measured = frequency_responses_of(run, centred(run))
    before, after = (
        response_costs(run, measured, rs.simulate(m, runs[0][0]).signals) for m in (plain, found.model)
    )
    assert after["ay"] < 0.7 * before["ay"]
    assert after["r"] == pytest.approx(before["r"]) and after["p"] == pytest.approx(before["p"])


def test_the_held_out_file_is_followed_better(found: rs.FullDiagnosis) -> None:
    """By all that was named together; the offset alone is not to be seen there."""
    before, after = found.held_out[0].before, found.held_out[0].after
    assert after.j_rms < 0.95 * before.j_rms and after.tic < before.tic
    share = found.held_out[0].share_removed
    assert share is not None and share > 0.1
