"""Acceptance against CIFER v6.3.00 on the Stanford P1 steer-by-wire car: one sweep of 20 s at 33 ft/s.

CIFER's bands begin at .4189 rad/s = 2 pi/15 s, so a window of 15 s is added to the five of 2 to 10 s
that suit a record of 20 s. Its a_y comes out at 173, not 51, with the plain equation a_y = v' + V r; an
accelerometer 1.05 ft above the point of v brings it to 44 without touching another parameter.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import loadmat

from rover_sweep.data.recording import Recording, Signal
from rover_sweep.identification.fit import Condition, FitResult, accuracy, costs, evaluated, fit, sampled
from rover_sweep.identification.state_space import Matrices, ModelStructure, Parameter
from rover_sweep.identification.verify import RATE, UNITS, Overlay, Verification, simulated_outputs, verify
from rover_sweep.spectra.response import frequency_responses

FOOT, SPEED = 0.3048, 33.0
WINDOWS = (2.0, 3.5, 5.0, 7.0, 10.0, 15.0)
BANDS = {
    "ay": (0.4189, 52.15),
    "beta": (0.4189, 41.86),
    "p": (1.15, 20.0),
    "phi": (0.4189, 20.0),
    "r": (0.4189, 53.70),
}
# value, Cramer-Rao bound and insensitivity in percent, as CIFER printed them
PRINTED = {
    "Yv": (-2.723, 10.34, 2.473),
    "Yr": (-50.99, 21.29, 0.3647),
    "Lv": (1.079, 12.98, 3.407),
    "Lr": (-27.37, 14.66, 0.2754),
    "Lphi": (-71.87, 5.804, 1.184),
    "Np": (10.01, 7.471, 2.047),
    "Nr": (-41.66, 12.23, 0.1687),
    "Ydel": (314.3, 11.22, 0.2092),
    "Ldel": (102.6, 12.97, 0.2689),
    "Ndel": (142.5, 12.47, 0.1711),
    "tau": (0.02871, 8.554, 2.455),
}
COSTS = {"ay": 50.596, "beta": 67.586, "p": 102.906, "phi": 86.560, "r": 17.592}
BEFORE, AFTER = (2.4527, 0.1434), (1.8027, 0.1008)  # J_rms and TIC before and after CIFER's bias solve


def lumped(p: Mapping[str, Any]) -> Matrices:
    """States v [ft/s], p, r [rad/s], phi [rad]; Yp, Lp, Nv eliminated; ay in m/s^2, z [ft] up."""
    v = p["V"]
    return Matrices(
        m=np.eye(4),
        f=np.array(
            [
                [p["Yv"], 0, p["Yr"] - v, 32.17],
                [p["Lv"], 0, p["Lr"], p["Lphi"]],
                [0, p["Np"], p["Nr"], 0],
                [0, 1, 0, 0],
            ]
        ),
        g=np.array([p["Ydel"], p["Ldel"], p["Ndel"], 0]),
        h0=np.array([[0, 0, v * FOOT, 0], [1 / v, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1], [0, 0, 1, 0]]),
        h1=np.array([[FOOT, -FOOT * p["z"], 0, 0], *np.zeros((4, 4))]),
    )


CIFER = ModelStructure(
    "P1",
    ("v", "p", "r", "phi"),
    ("ay", "beta", "p", "phi", "r"),
    (*(Parameter(n, "", value, True) for n, (value, _, _) in PRINTED.items()), Parameter("z", "ft", 0.0)),
    lumped,
    "CIFER v6.3.00",
)


def recorded(path: Path, every: int = 1) -> Recording:
    """Channels in rad, rad/s and m/s^2 on the file's own clock, every so many samples."""
    file = loadmat(path)
    t = file["time"].ravel()[::every]
    units = {"delta": "rad", "ay": "m/s^2", "p": "rad/s", "r": "rad/s", "beta": "rad", "phi": "rad"}
    channels = {
        name: Signal(t, file[name].ravel()[::every] * (FOOT if name == "ay" else 1.0), unit, name)
        for name, unit in units.items()
        if name in file
    }
    channels["speed"] = Signal(t, np.full(t.size, SPEED), "ft/s")
    return Recording(path.stem, channels, (float(t[0]), float(t[-1])), "sweep")


@pytest.fixture(scope="module")
def condition(foreign_recordings: Path) -> Condition:
    """The five responses in CIFER's bands, at the 20 points of each."""
    path = foreign_recordings / "p1" / "P1_Final_Sweep.mat"
    if not path.is_file():
        pytest.skip(f"no {path.name} in {path.parent}")
    w = np.unique(np.concatenate([np.geomspace(*band, 20) for band in BANDS.values()]))
    found = frequency_responses([recorded(path)], tuple(BANDS), w, WINDOWS)["delta"]
    return Condition(SPEED, tuple(sampled(found[o], band) for o, band in BANDS.items()), {})


def of(condition: Condition, *outputs: str) -> Condition:
    return Condition(SPEED, tuple(d for d in condition.data if d.output in outputs), {})


def test_costs_at_cifers_parameters(condition: Condition):
    found = costs(CIFER, [condition])
    for output in ("r", "beta", "p", "phi"):
        assert found[output] <= COSTS[output]
    assert found["ay"] == pytest.approx(
        170, rel=0.1
    )  # as it comes out: the plain equation leaves something out


def test_accuracies_at_cifers_parameters(condition: Condition):
    bound, insensitivity = accuracy(CIFER, [condition])
    for k, parameter in enumerate(CIFER.free):
        _, printed_bound, printed_insensitivity = PRINTED[parameter.name]
        assert bound[k] == pytest.approx(printed_bound, rel=0.30), parameter.name
        assert insensitivity[k] == pytest.approx(printed_insensitivity, rel=0.40), parameter.name


def test_a_fit_from_there_is_better(condition: Condition):
    four = of(condition, "r", "beta", "p", "phi")
    found: FitResult = fit(CIFER, [four])
    assert found.average <= 45
    assert found.average < evaluated(CIFER, [four]).average
    for name in ("Yv", "Lphi", "Ldel", "Ndel", "Np"):
        assert found[name].value == pytest.approx(PRINTED[name][0], rel=0.15)


def test_an_accelerometer_above_the_point_of_v_explains_ay(condition: Condition):
    """One number, z, fitted to a_y alone with everything else as CIFER has it."""
    found = fit(CIFER.with_free(["z"]), [of(condition, "ay")])
    assert found.costs["ay"] <= COSTS["ay"]
    assert 0.8 < found["z"].value < 1.3  # ft


def test_verification_on_the_other_file(foreign_recordings: Path):
    """Decimated to 25 Hz: 2.92 and .175 before, 2.46 and .144 after constant biases are solved.

    CIFER printed 2.45 and .143 before its bias solve, so where we end it began: offsets of the outputs
    alone bring us there. Its 1.80 and .101 are out of reach of any constant bias: the car is at standstill
    until t = 14 s and then drives at a_y/r = 14-19 ft/s in place of the model's 33.
    """
    path = foreign_recordings / "p1" / "P1_Final_Verify.mat"
    if not path.is_file():
        pytest.skip(f"no {path.name} in {path.parent}")
    run = recorded(path, every=20)
    assert run["r"].rate == pytest.approx(25.0)
    before, after = unbiased(run), verify(CIFER, run)
    assert (before.j_rms, before.tic) == pytest.approx(BEFORE, rel=0.25)
    assert after.j_rms < before.j_rms
    assert after.tic < before.tic
    assert (after.j_rms, after.tic) == pytest.approx(BEFORE, rel=0.02)
    assert after.j_rms > AFTER[0]
    turning = run["r"].x > 0.4
    assert np.median(run["ay"].x[turning] / run["r"].x[turning]) / FOOT == pytest.approx(16, abs=3)


def unbiased(run: Recording) -> Verification:
    """The model driven by the steering as recorded, nothing solved."""
    t = run["r"].t
    grid = t[0] + np.arange(int((t[-1] - t[0]) * RATE) + 1) / RATE
    model = simulated_outputs(CIFER, SPEED, run["delta"].on(grid), RATE, {})
    overlays = tuple(
        Overlay(c, UNITS[c][0], t, UNITS[c][1] * run[c].x, UNITS[c][1] * np.interp(t, grid, model[c]))
        for c in ("r", "ay", "p")
    )
    return Verification(run.name, SPEED, overlays, {}, {})
