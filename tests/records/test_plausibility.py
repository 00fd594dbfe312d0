"""Numbers that are probably wrong are named, in the vehicle file and in results; real rovers pass."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rover_sweep.data.geometry import Geometry
from rover_sweep.data.plausibility import implausible
from rover_sweep.data.vehicle_file import load
from rover_sweep.data.vehicle_geometry import geometry_of
from tests.foreign.rover import SIZES, Size, draw_rover

DATA = Path(__file__).parents[1] / "data"
ROVER = geometry_of(load(DATA / "rover.toml"))
FILES = [DATA / "rover.toml", *sorted(DATA.glob("concealed-ardurover/*/rover.toml"))]
FILES += sorted(DATA.glob("cars/*.vehicle.toml"))


@pytest.mark.parametrize("file", FILES, ids=lambda p: p.parent.name + "-" + p.stem)
def test_the_files_of_measured_vehicles_are_plausible(file: Path) -> None:
    assert implausible(geometry_of(load(file))) == ()


@pytest.mark.parametrize("size", SIZES, ids=lambda s: s.name)
def test_drawn_rovers_of_all_sizes_are_plausible(size: Size) -> None:
    for seed in range(20):
        n = draw_rover(np.random.default_rng(seed), size).numbers
        rover = Geometry(n.m, n.a, n.b, n.ms, n.h, n.Ixx, n.Izz)
        assert implausible(rover, {"Cf": n.Cf, "Cr": n.Cr, "Izz": n.Izz, "k_phi": n.kphi}) == ()


@pytest.mark.parametrize(
    ("wrong", "check"),
    [
        ({"mass": 26.6}, "Check mass first"),
        ({"mass": 0.5, "sprung_mass": None, "yaw_inertia": 0.2}, "Check mass or yaw_inertia first"),
        ({"sprung_mass": 0.24}, "Check sprung_mass first"),
        ({"roll_inertia": 0.125}, "Check roll_inertia first"),
        ({"yaw_inertia": 0.0069}, "Check yaw_inertia first"),
        ({"h": 0.30}, "Check cg_height_above_roll_centre first"),
    ],
    ids=str,
)
def test_a_slip_in_the_file_is_named(wrong: dict[str, float | None], check: str) -> None:
    (sentence,) = implausible(replace(ROVER, **wrong))
    assert sentence.startswith("the vehicle file is implausible: ") and check in sentence


@pytest.mark.parametrize(
    ("found", "words"),
    [
        (
            {"Izz": 7 * 0.069},
            "Izz = 0.483 kg m^2 is implausible: it is 7 times the 0.069 kg m^2 of the vehicle",
        ),
        (
            {"Izz": 0.069 / 20},
            "it is 0.05 times the 0.069 kg m^2 of the vehicle file (plausible: 0.6 to 1.7)",
        ),
        (
            {"C": 6.0},
            "C = 6 N/rad is implausible: cornering stiffness of the front axle / its load is 0.48 per rad",
        ),
        ({"Cf": 40.0, "Cr": 2000.0}, "Cr = 2e+03 N/rad is implausible: cornering stiffness of the rear axle"),
        (
            {"Cf": 267.0, "Cr": 30.0},
            "Cf = 267 N/rad is implausible: cornering stiffness over load, front axle over rear axle is 9.6",
        ),
        ({"k_phi": 1.4}, "k_phi = 1.4 N m/rad is implausible: roll per lateral acceleration is "),
        (
            {"steering_scale": 2.0},
            "a steering scale of 2 times rad_per_us is implausible (plausible: 0.7 to 1.4)",
        ),
    ],
    ids=str,
)
def test_an_absurd_result_is_named(found: dict[str, float], words: str) -> None:
    assert any(words in sentence for sentence in implausible(ROVER, found))


def test_a_usual_result_is_not_accused_and_an_unknown_one_is_ignored() -> None:
    usual = {"C": 38.0, "Izz": 0.075, "k_phi": 9.5, "steering_scale": 1.1, "tau": 9.0, "Ixx": math.nan}
    assert implausible(ROVER, usual) == ()


def test_without_a_yaw_inertia_in_the_file_the_radius_of_gyration_judges() -> None:
    (sentence,) = implausible(replace(ROVER, yaw_inertia=None), {"Izz": 0.49})
    assert "radius of gyration in yaw / wheelbase is 1.1 (plausible: 0.2 to 0.75)" in sentence
