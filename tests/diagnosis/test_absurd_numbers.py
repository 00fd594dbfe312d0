"""A diagnosis whose numbers are absurd says so first, and explains nothing."""

from __future__ import annotations

from dataclasses import replace
from math import log
from pathlib import Path

import pytest

import rover_sweep as rs
from rover_sweep.data.plausibility import implausible
from rover_sweep.data.vehicle_file import Measured, load
from rover_sweep.data.vehicle_geometry import geometry_of
from rover_sweep.diagnosis.simulation.candidates import physical_numbers

DATA = Path(__file__).parents[1] / "data"


def test_the_coordinates_of_a_model_are_judged_as_physical_numbers() -> None:
    geometry = geometry_of(load(DATA / "rover.toml"))
    x = {"ln_C": log(30.0), "ln_ratio": 0.2, "ln_Izz": log(0.07), "ln_k_phi": log(10.0), "ln_Ixx": 0.1}
    found = physical_numbers({**x, "ln_h": 0.05, "scale": 0.03}, geometry)
    assert found["Cf"] / found["Cr"] == pytest.approx(1.2214, rel=1e-3)
    assert found["steering_scale"] == 1.03 and implausible(geometry, found) == ()
    odd = physical_numbers({**x, "ln_Izz": log(0.49), "scale": 1.0}, geometry)
    assert [words.partition(" is ")[0] for words in implausible(geometry, odd)] == [
        "Izz = 0.49 kg m^2",
        "a steering scale of 2 times rad_per_us",
    ]


def test_an_implausible_file_is_said_first_and_nothing_is_explained() -> None:
    runs = rs.read(DATA / "ardurover-4.6.3/nominal/run1.BIN", vehicle=DATA / "rover.toml")
    assert runs.vehicle is not None
    heavy = replace(runs.vehicle, mass=Measured(26.6))
    found = rs.diagnose(rs.Runs(tuple(runs), heavy), only=["servo_lag"])
    assert found.sentence.startswith("the vehicle file is implausible: sprung mass / mass is 0.09")
    assert found.verdict == "unexplained"
