"""The corrected equations and the accuracy formulas against the paper's Tables 2 and 3.

The expected numbers are an independent recomputation at the published parameters with coherence 1,
20 log-spaced points a response, V = 2.4 m/s and the plain output a_y = V_y' + V r.
"""

from dataclasses import replace

import numpy as np
import pytest

from rover_sweep.data.geometry import Geometry
from rover_sweep.identification.fit import Condition, ResponseData, accuracy
from rover_sweep.identification.models import bicycle, roll_yaw
from rover_sweep.identification.state_space import Matrices, ModelStructure

PAPER = Geometry(mass=2.64, a=0.33, b=0.24, sprung_mass=2.38, h=0.06, roll_inertia=0.008)
TABLE_2 = {"C": 22.6, "Izz": 0.085, "tau": 0.072}
TABLE_3 = {"C": 35.34, "Izz": 0.056, "k_phi": 10.4, "b_phi": 0.828, "tau": 0.088}
PUBLISHED = {"r": (0.2, 25.0), "ay": (0.2, 25.0), "vydot": (3.0, 25.0), "p": (0.6, 20.0)}


def without_gravity_in_ay(structure: ModelStructure) -> ModelStructure:
    def build(p) -> Matrices:
        mat = structure.build(p)
        h0 = mat.h0.copy()
        h0[1, -1] = 0.0
        return replace(mat, h0=h0)

    return replace(structure, build=build)


def at_coherence_one(structure: ModelStructure, bands: dict[str, tuple[float, float]]) -> Condition:
    data = []
    for output, band in bands.items():
        w = np.geomspace(*band, 20)
        data.append(ResponseData(output, w, structure.response(w, 2.4, output), np.ones(20)))
    return Condition(2.4, tuple(data), {})


def test_poles_of_table_3():
    poles = roll_yaw(PAPER).with_values(TABLE_3).poles(2.4)
    assert np.sort(poles.real) == pytest.approx([-94.3, -44.8, -9.60, -9.60], rel=2e-3)
    assert np.max(poles.imag) == pytest.approx(2.98, rel=5e-3)


@pytest.mark.parametrize(
    ("name", "cr", "i"),
    [("k_phi", 3.63, 1.78), ("b_phi", 8.15, 3.80), ("Izz", 4.64, 2.18), ("C", 0.82, 0.40)],
)
def test_roll_yaw_accuracy(name: str, cr: float, i: float):
    structure = without_gravity_in_ay(roll_yaw(PAPER).with_values(TABLE_3))
    bounds, insensitivities = accuracy(structure, [at_coherence_one(structure, PUBLISHED)])
    k = [p.name for p in structure.free].index(name)
    assert bounds[k] == pytest.approx(cr, rel=0.02)
    assert insensitivities[k] == pytest.approx(i, rel=0.02)


@pytest.mark.parametrize(
    ("bands", "cr", "i"),
    [
        ({k: PUBLISHED[k] for k in ("r", "ay", "vydot")}, (2.5, 5.7, 4.1), (1.2, 2.2, 1.6)),
        ({"r": (0.2, 15.0), "ay": (0.2, 15.0)}, (7.9, 16.3, 8.1), (2.4, 5.3, 3.7)),
    ],
)
def test_bicycle_accuracy(bands: dict, cr: tuple, i: tuple):
    structure = bicycle(PAPER).with_values(TABLE_2)
    bounds, insensitivities = accuracy(structure, [at_coherence_one(structure, bands)])
    assert bounds == pytest.approx(cr, abs=0.07, rel=0.02)  # the printed figures have one decimal
    assert insensitivities == pytest.approx(i, abs=0.07, rel=0.02)


@pytest.mark.parametrize("structure", [bicycle(PAPER).with_values(TABLE_2), roll_yaw(PAPER, tied=False)])
@pytest.mark.parametrize("output", ["r", "ay", "vydot", "p"])
def test_sensitivities_are_the_slopes_of_the_response(structure: ModelStructure, output: str):
    if output not in structure.outputs:
        pytest.skip("not an output of this model")
    w = np.geomspace(0.3, 25, 7)
    slopes = structure.log_sensitivity(w, 2.4, output)
    for k, p in enumerate(structure.free):
        step = 1e-5 * p.value
        up, down = (
            structure.with_values({p.name: p.value + s}).response(w, 2.4, output) for s in (step, -step)
        )
        assert slopes[:, k] == pytest.approx(np.log(up / down) / (2 * step), rel=1e-5, abs=1e-7)


def test_the_cost_of_one_decibel_everywhere():
    from rover_sweep.identification.fit import costs

    structure = bicycle(PAPER).with_values(TABLE_2)
    condition = at_coherence_one(structure, {"r": (0.3, 25.0)})
    louder = replace(condition.data[0], h=condition.data[0].h * 10 ** (1 / 20))
    turned = replace(condition.data[0], h=condition.data[0].h * np.exp(1j * np.radians(7.57)))
    assert costs(structure, [replace(condition, data=(louder,))])["r"] == pytest.approx(19.95, rel=1e-3)
    assert costs(structure, [replace(condition, data=(turned,))])["r"] == pytest.approx(19.95, rel=2e-3)


def test_the_coherence_weight_is_that_of_the_paper():
    """exp(-g2), not exp(-g2^2), which is a mistake found in public code."""
    data = ResponseData("r", np.ones(3), np.ones(3, dtype=complex), np.array([0.0, 0.6, 1.0]))
    assert data.weight == pytest.approx(
        [0.0, (1.58 * (1 - np.exp(-0.6))) ** 2, (1.58 * (1 - np.exp(-1))) ** 2]
    )


def test_an_imu_ahead_of_the_cg_feels_the_yaw_acceleration():
    w = np.array([15.0])
    ahead, there = (bicycle(replace(PAPER, imu_x=x)).with_values(TABLE_2) for x in (0.1, 0.0))
    difference = ahead.response(w, 2.4, "ay") - there.response(w, 2.4, "ay")
    assert difference == pytest.approx(0.1 * 1j * w * there.response(w, 2.4, "r"), rel=1e-12)
