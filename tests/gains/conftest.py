"""The identification of the nominal recordings, once for all tests of the gains."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Any

import pytest

import rover_sweep as rs
from rover_sweep.gains.identified import from_identification
from rover_sweep.gains.proposal import Proposal, propose_gains
from rover_sweep.gains.steering_chain import autopilot
from rover_sweep.report.identification.identification_json import identification_document

DATA = Path(__file__).parents[1] / "data"
NOMINAL = DATA / "ardurover-4.6.3" / "nominal"
AS_RECORDED = {"SCHED_LOOP_RATE": 100.0, "INS_GYRO_FILTER": 20.0}


@pytest.fixture(scope="session")
def nominal_result() -> Any:
    names = ("run1", "run2", "run4")
    runs = rs.read(*(NOMINAL / f"{name}.BIN" for name in names), vehicle=DATA / "rover.toml")
    return rs.identify(runs, models=["bicycle", "roll-yaw"], bootstrap=20)


@pytest.fixture(scope="session")
def nominal_text(nominal_result: Any) -> str:
    return json.dumps(identification_document(nominal_result, nominal_result.origin))


@pytest.fixture
def document(nominal_text: str) -> Any:
    """identification.json, to be changed by a test."""
    return copy.deepcopy(json.loads(nominal_text))


@pytest.fixture(scope="session")
def proposal(nominal_text: str) -> Proposal:
    """For 2.5 m/s, with the loop rate and gyro filter of the recordings and the firmware's own gains: the
    whole design, not a step towards it."""
    found = from_identification(json.loads(nominal_text))
    return propose_gains(found, autopilot(AS_RECORDED), 2.5, at_once=True)


@pytest.fixture
def few_corners(monkeypatch: pytest.MonkeyPatch) -> None:
    """For tests that need no design for every corner of the intervals."""
    monkeypatch.setattr("rover_sweep.gains.proposal.MOST_CORNERS", 1)
