"""Models in python-control and scipy answer as the structures do."""

from __future__ import annotations

import sys

import numpy as np
import pytest
import scipy.signal

import rover_sweep as rs
from rover_sweep.data.geometry import Geometry
from rover_sweep.data.recording import LowPass
from rover_sweep.identification.conversion import pade_delay
from rover_sweep.identification.models import bicycle, roll_yaw
from rover_sweep.identification.state_space import ModelStructure

GEOMETRY = Geometry(mass=2.66, a=0.203, b=0.188, sprung_mass=2.40, h=0.058, roll_inertia=0.0125, imu_x=0.03)
MODEL = roll_yaw(GEOMETRY).with_values({"C": 32.0, "Izz": 0.071, "k_phi": 10.8, "b_phi": 0.36, "tau": 0.043})
SPEED = 2.4
W = np.geomspace(0.3, 25, 12)
pytestmark = pytest.mark.filterwarnings("ignore:Badly conditioned")


def expected(model: ModelStructure, filters: dict[str, LowPass] | None = None) -> np.ndarray:
    return np.array([model.response(W, SPEED, o, filters) for o in model.outputs])


@pytest.mark.parametrize("model", [bicycle(GEOMETRY), MODEL])
def test_state_space_of_python_control(model: ModelStructure) -> None:
    control = pytest.importorskip("control")
    system = rs.to_control(model, SPEED, pade=4)
    assert isinstance(system, control.StateSpace)
    np.testing.assert_allclose(system(1j * W)[:, 0], expected(model), rtol=1e-6)
    assert system.output_labels == list(model.outputs) and system.input_labels == ["delta"]
    assert [s for s in system.state_labels if s in model.states] == list(model.states)
    slow = {"r": LowPass(4.0), "ay": LowPass(10.0)}
    behind = rs.to_control(model, SPEED, pade=4, sensors=slow)(1j * W)[:, 0]
    np.testing.assert_allclose(behind, expected(model, slow), rtol=1e-6)
    at_once = rs.to_control(model, SPEED, pade=0)
    assert list(at_once.state_labels) == list(model.states)
    late = np.exp(-1j * W * model.values["tau"])
    np.testing.assert_allclose(at_once(1j * W)[:, 0] * late, expected(model), rtol=1e-9)


def test_pade_by_its_printed_second_order_form() -> None:
    tau = 0.3
    num, den = pade_delay(tau, 2)
    np.testing.assert_allclose(den / den[-1], [tau**2 / 12, tau / 2, 1])
    np.testing.assert_allclose(num / num[-1], [tau**2 / 12, -tau / 2, 1])


def test_continuous_scipy() -> None:
    system = rs.to_scipy(MODEL, SPEED, pade=4)
    assert isinstance(system, scipy.signal.StateSpace)
    _, h = scipy.signal.freqresp(scipy.signal.StateSpace(system.A, system.B, system.C[:1], system.D[:1]), W)
    np.testing.assert_allclose(h, expected(MODEL)[0], rtol=1e-5)


@pytest.mark.parametrize("tau", [0.0, 0.0123, 0.04, 0.043])
def test_discrete_scipy_equals_a_fine_simulation_at_the_samples(tau: float) -> None:
    """A held random input; the reference holds it on a grid of 0.1 ms on which every delay is whole."""
    dt, fine = 0.01, 1e-4
    model = MODEL.with_values({"tau": tau})
    u = np.random.default_rng(1).standard_normal(80)
    _, y, _ = scipy.signal.dlsim(rs.to_scipy(model, SPEED, dt=dt), u)
    steps = round(dt / fine)
    held = np.concatenate((np.zeros(round(tau / fine)), np.repeat(u, steps)))[: u.size * steps]
    _, slow, _ = scipy.signal.dlsim(rs.to_scipy(model.with_values({"tau": 0.0}), SPEED, dt=fine), held)
    np.testing.assert_allclose(y, slow[::steps], rtol=1e-8, atol=1e-10)


def test_without_python_control_one_sentence_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "control", None)
    with pytest.raises(rs.UsageError, match=r"pip install -e '\.\[control\]'"):
        rs.to_control(MODEL, SPEED)
