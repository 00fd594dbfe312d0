"""The sign of the IMU's place in the vehicle file: with the wrong one no model is good, and it is named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from damage import NOMINAL

import rover_sweep as rs
from rover_sweep.identify.geometry import Geometry
from rover_sweep.identify.grouping import Settings
from rover_sweep.identify.identification import Identification, identify
from rover_sweep.identify.recording import Recording
from rover_sweep.preparation import geometry_of

VEHICLE = NOMINAL.parents[1] / "rover.toml"
NAMED = "the IMU's place has the wrong sign"


@pytest.fixture(scope="module")
def runs() -> rs.Runs:
    return rs.read(NOMINAL / "run1.BIN", NOMINAL / "run2.BIN", vehicle=VEHICLE)


def moved(run: Recording, x: float, z: float) -> Recording:
    """The run with its accelerometer moved by x [m] forward and z [m] up: a_y + x r' - z p'."""
    r, p, ay = run["r"], run["p"], run["ay"]
    slopes = (np.interp(ay.t, s.t, np.gradient(s.x, s.t)) for s in (r, p))
    shift = sum(k * slope for k, slope in zip((x, -z), slopes, strict=True))
    return replace(run, channels={**run.channels, "ay": replace(ay, x=ay.x + shift)})


def identified(runs: rs.Runs, true: tuple[float, float], told: tuple[float, float]) -> Identification:
    assert runs.vehicle is not None
    geometry: Geometry = replace(geometry_of(runs.vehicle), imu_x=told[0], imu_z=told[1])
    return identify([moved(run, *true) for run in runs], geometry, (), Settings(models=("roll-yaw",)))


@pytest.mark.parametrize(
    ("true", "told", "axis"), [((0.1, 0.0), (-0.1, 0.0), "forward"), ((0.0, 0.0), (0.0, 0.116), "down")]
)
def test_a_wrong_sign_is_named(
    runs: rs.Runs, true: tuple[float, float], told: tuple[float, float], axis: str
) -> None:
    found = identified(runs, true, told)
    sentence = found.models["roll-yaw"].verdict.sentences[0]
    assert sentence.startswith(f"{NAMED}: with {axis} of imu.position the other way round, J_ave falls from")
    assert found.models["roll-yaw"].verdict.level in ("poor", "not identifiable")
    assert any(NAMED in words for words in found.summary)


@pytest.mark.parametrize("place", [(0.0, 0.0), (0.1, 0.0), (-0.1, 0.0), (0.0, 0.116)])
def test_a_right_place_is_not_doubted(runs: rs.Runs, place: tuple[float, float]) -> None:
    found = identified(runs, place, place)
    assert not any(NAMED in words for words in found.summary)
    assert found.models["roll-yaw"].verdict.level == "good"
