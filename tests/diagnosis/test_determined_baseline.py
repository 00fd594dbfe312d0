"""The baseline of a diagnosis is the model that the runs determine, not more."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

import rover_sweep as rs
from rover_sweep.api.diagnosis_input import diagnosed, material
from rover_sweep.data.results import ByName
from rover_sweep.data.vehicle_geometry import geometry_of
from rover_sweep.diagnosis.result import Diagnosis, DiagnosisSettings, Finding
from rover_sweep.errors import UsageError
from rover_sweep.identification.grouping import Settings, grouped
from rover_sweep.identification.model_results import determined_model

DATA = Path(__file__).parents[1] / "data"
FIRMWARE = DATA / "ardurover-4.6.3"


@pytest.fixture(scope="module")
def stock() -> rs.Runs:
    """ArduPilot's own kinematic rover: no sideslip, no roll."""
    return rs.read(*(FIRMWARE / "stock" / f"run{n}.BIN" for n in (1, 2)), vehicle=DATA / "rover.toml")


def test_a_rover_without_tyres_and_roll_is_diagnosed_as_kinematic(stock: rs.Runs):
    assert stock.vehicle is not None
    settings = DiagnosisSettings(with_effects=("steering_scale",), time_limit=0.1)
    found = diagnosed(material(tuple(stock), ()), stock.vehicle, settings)
    assert found.baseline == "kinematic" and found.model is not None and found.model.baseline == "kinematic"
    assert any(r.startswith("the baseline is the kinematic model: ") for r in found.remarks)
    assert rs.identify(stock, bootstrap=0).recommended == "kinematic"


def test_candidates_that_the_baseline_cannot_lack_are_refused(stock: rs.Runs):
    with pytest.raises(UsageError, match="none of roll_steer can be missing from the kinematic baseline"):
        rs.diagnose(stock, only=["roll_steer"])


@pytest.mark.parametrize(
    ("without", "baseline", "why"),
    [
        ((), "roll-yaw", ""),
        (("p",), "bicycle", "the roll rate does not follow the steering (it was not recorded)"),
    ],
)
def test_a_rover_with_tyres_is_diagnosed_with_them(without: tuple[str, ...], baseline: str, why: str):
    runs = rs.read(FIRMWARE / "defaults" / "run1.BIN", vehicle=DATA / "rover.toml")
    assert runs.vehicle is not None
    given = [run.without(set(without)) for run in runs]
    found = determined_model(grouped(given, Settings()), geometry_of(runs.vehicle))
    assert found[0] == baseline and why in found[1]


def test_without_the_numbers_of_roll_the_bicycle_is_the_most_complete_model():
    runs = rs.read(FIRMWARE / "defaults" / "run1.BIN", vehicle=DATA / "rover.toml")
    assert runs.vehicle is not None
    geometry = replace(geometry_of(runs.vehicle), roll_inertia=None)
    found = determined_model(grouped(tuple(runs), Settings()), geometry)
    assert (
        found[0] == "bicycle"
        and "needs sprung_mass, cg_height_above_roll_centre and roll_inertia" in found[1]
    )


def test_a_baseline_that_lacks_roll_gives_way_to_one_with_it(monkeypatch: pytest.MonkeyPatch):
    """One channel's coherence hid the roll that all channels together show: it is no left-out physics."""
    asked, limits = [], []

    def found(runs, rover, settings, *others):
        asked.append(settings.baseline)
        limits.append(settings.time_limit)
        effect = Finding("roll_dof", (), ByName(()), {}, (), "", "", "")
        return Diagnosis("explained", "", settings.baseline, findings=(effect,) if len(asked) == 1 else ())

    monkeypatch.setattr("rover_sweep.diagnosis.diagnose.diagnose", found)
    monkeypatch.setattr("rover_sweep.api.diagnosis_input.determined_model", lambda *_: ("bicycle", "no roll"))
    runs = rs.read(FIRMWARE / "defaults" / "run1.BIN", vehicle=DATA / "rover.toml")
    assert runs.vehicle is not None
    answer = diagnosed(material(tuple(runs), ()), runs.vehicle, DiagnosisSettings(time_limit=60.0))
    assert limits[0] == 60.0 and 0.0 < limits[1] < 60.0  # one limit for both
    assert asked == ["bicycle", "roll-yaw"] and answer.baseline == "roll-yaw" and not answer.findings
    assert not any(r.startswith("the baseline is") for r in answer.remarks)
    diagnosed(material(tuple(runs), ()), runs.vehicle, DiagnosisSettings("bicycle"))
    assert asked[2:] == ["bicycle"]
