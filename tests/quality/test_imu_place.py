"""The sign of the IMU's place in the vehicle file: with the wrong one no model is good, and it is named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from damage import NOMINAL

import rover_sweep as rs
from rover_sweep.api.diagnosis_input import Material, diagnosed
from rover_sweep.data.geometry import Geometry
from rover_sweep.data.recording import Recording
from rover_sweep.data.vehicle_file import Vehicle
from rover_sweep.data.vehicle_geometry import geometry_of
from rover_sweep.diagnosis.result import Diagnosis, DiagnosisSettings
from rover_sweep.identification.grouping import Settings, grouped
from rover_sweep.identification.pipeline import Identification, identify, wrong_place_in

VEHICLE = NOMINAL.parents[1] / "rover.toml"
NAMED = "the IMU's position has the wrong sign"


@pytest.fixture(scope="module")
def runs() -> rs.Runs:
    return rs.read(NOMINAL / "run1.BIN", NOMINAL / "run2.BIN", vehicle=VEHICLE)


def moved(run: Recording, x: float, z: float) -> Recording:
    """The run with its accelerometer moved by x [m] forward and z [m] up: a_y + x r' - z p'."""
    r, p, ay = run["r"], run["p"], run["ay"]
    slopes = (np.interp(ay.t, s.t, np.gradient(s.x, s.t)) for s in (r, p))
    shift = sum(k * slope for k, slope in zip((x, -z), slopes, strict=True))
    return replace(run, channels={**run.channels, "ay": replace(ay, x=ay.x + shift)})


def identified(runs: rs.Runs, true: tuple[float, float], stated: tuple[float, float]) -> Identification:
    assert runs.vehicle is not None
    geometry: Geometry = replace(geometry_of(runs.vehicle), imu_x=stated[0], imu_z=stated[1])
    return identify([moved(run, *true) for run in runs], geometry, (), Settings(models=("roll-yaw",)))


@pytest.mark.parametrize(
    ("true", "stated", "axis"),
    [
        ((0.1, 0.0), (-0.1, 0.0), "forward"),
        ((0.05, 0.0), (-0.05, 0.0), "forward"),
        ((-0.05, 0.0), (0.05, 0.0), "forward"),
        ((0.0, 0.0), (0.0, 0.116), "down"),
    ],
)
def test_a_wrong_sign_is_named(
    runs: rs.Runs, true: tuple[float, float], stated: tuple[float, float], axis: str
) -> None:
    found = identified(runs, true, stated)
    sentence = found.models["roll-yaw"].verdict.sentences[0]
    assert sentence.startswith(f"{NAMED}: with {axis} of imu.position reversed, J_ave falls from")
    assert found.models["roll-yaw"].verdict.level in ("poor", "not identifiable")
    assert any(NAMED in words for words in found.summary)


@pytest.mark.parametrize(
    "place", [(0.0, 0.0), (0.1, 0.0), (-0.1, 0.0), (0.05, 0.0), (-0.03, 0.0), (0.0, 0.116)]
)
def test_a_right_place_is_not_doubted(runs: rs.Runs, place: tuple[float, float]) -> None:
    found = identified(runs, place, place)
    assert not any(NAMED in words for words in found.summary)
    assert found.models["roll-yaw"].verdict.level == "good"


def test_without_a_yaw_inertia_in_the_file_mass_and_axles_tell(runs: rs.Runs) -> None:
    """5 cm on the wrong side: C 78 for 32, at a J_ave of 6 for 5."""
    assert runs.vehicle is not None
    geometry = replace(geometry_of(runs.vehicle), yaw_inertia=None, imu_x=-0.05)
    words = wrong_place_in(grouped([moved(run, 0.05, 0.0) for run in runs], Settings()), geometry, "roll-yaw")
    assert words.startswith(f"{NAMED}: with forward") and "(mass and axles suggest 0.0761)" in words


def test_a_diagnosis_says_it_too(runs: rs.Runs, monkeypatch: pytest.MonkeyPatch) -> None:
    assert runs.vehicle is not None
    monkeypatch.setattr(
        "rover_sweep.diagnosis.diagnose.diagnose", lambda *_: Diagnosis("none", "", "roll-yaw")
    )
    given = Material(tuple(moved(run, 0.05, 0.0) for run in runs))
    right, wrong = (diagnosed(given, at(runs.vehicle, x), DiagnosisSettings()) for x in (0.05, -0.05))
    assert any(words.startswith(NAMED) for words in wrong.remarks)
    assert not any(words.startswith(NAMED) for words in right.remarks)


def at(vehicle: Vehicle, forward: float) -> Vehicle:
    """The vehicle with its IMU so far ahead of the CG [m]."""
    assert vehicle.imu_position is not None
    x, y, z = vehicle.imu_position
    return replace(vehicle, imu_position=(replace(x, value=forward), y, z))
