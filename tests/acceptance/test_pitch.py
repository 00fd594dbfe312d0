"""Acceptance against CIFER v6.3.00 on a fixed-wing pitch sweep: elevator to pitch rate, 1-30 rad/s.

290 s on uneven stamps (20-50 ms apart), at the 8762 frequencies of the benchmark.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rover_sweep.data.recording import Recording, Signal
from rover_sweep.identification.fit import Condition, fit, sampled
from rover_sweep.identification.state_space import Matrices, ModelStructure, Parameter
from rover_sweep.identification.verdicts import reduce_model
from rover_sweep.spectra.response import FrequencyResponse, default_windows, frequency_responses

BAND, FREQUENCIES = (1.0, 30.0), 8762
PRINTED = {"z": 2.890, "zeta": 0.6259, "wn": 6.106}  # rad/s, -, rad/s


def second_order_and_lag(p: Mapping[str, Any]) -> Matrices:
    """q/delta = K (s + z) / ((s^2 + 2 zeta wn s + wn^2) (T s + 1)), states of the controllable form and q."""
    return Matrices(
        m=np.diag([1.0, 1.0, 0.0]) + p["T"] * np.diag([0, 0, 1]),
        f=np.array([[0, 1, 0], [-(p["wn"] ** 2), -2 * p["zeta"] * p["wn"], 0], [p["z"], 1, -1]]),
        g=np.array([0, p["K"], 0]),
        h0=np.array([[0.0, 0, 1]]),
        h1=np.zeros((1, 3)),
    )


PITCH = ModelStructure(
    "pitch",
    ("x", "x'", "q"),
    ("q",),
    (
        Parameter("K", "1/s", 1.0, True, -100.0, 100.0),
        Parameter("z", "rad/s", 1.0, True, 1e-2, 50.0),
        Parameter("zeta", "", 0.5, True, 1e-2, 3.0),
        Parameter("wn", "rad/s", 10.0, True, 0.5, 50.0),
        Parameter("T", "s", 0.05, True, 0.0, 1.0),
        Parameter("tau", "s", 0.01, True, -0.1, 0.3),
    ),
    second_order_and_lag,
    "anchors of CIFER",
)


@pytest.fixture(scope="module")
def response(foreign_recordings: Path) -> FrequencyResponse:
    path = foreign_recordings / "pitch" / "sweep.npy"
    if not path.is_file():
        pytest.skip(f"no {path.name} in {path.parent}")
    columns = np.load(path)
    t, elevator, q = columns[:, 0], columns[:, 1], columns[:, 4]
    channels = {"delta": Signal(t, elevator, "1"), "q": Signal(t, q, "deg/s")}
    run = Recording("pitch", channels, (float(t[0]), float(t[-1])), "sweep")
    total = run.span[1] - run.span[0]
    w = np.linspace(*BAND, FREQUENCIES)
    return frequency_responses([run], ["q"], w, default_windows(*BAND, total, total))["delta"]["q"]


def test_zero_damping_and_frequency(response: FrequencyResponse):
    """Reduction drops the third pole, which the responses hardly show; the others are within 2 %."""
    assert response.band == pytest.approx(BAND)
    assert np.min(response.coherence) > 0.9
    conditions = [Condition(0.0, (sampled(response, BAND, 20),), {})]
    full = fit(PITCH, conditions, [{"z": 4.0, "wn": 5.0}, {"K": -1.0}])
    found, steps = reduce_model(full, conditions)
    assert [s.parameter for s in steps if s.dropped] == ["T"]
    for name, printed in PRINTED.items():
        assert found[name].value == pytest.approx(printed, rel=0.02), name
    assert found.average < 2
