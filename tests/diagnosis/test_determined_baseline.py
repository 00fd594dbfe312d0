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
    return rs.read(FIRMWARE / "stock" / "run1.BIN", vehicle=DATA / "rover.toml")


def test_a_rover_without_tyres_and_roll_is_diagnosed_as_kinematic(stock: rs.Runs):
    """A search that is stopped reports no finding that was not compared."""
    assert stock.vehicle is not None
    found = diagnosed(material(tuple(stock), ()), stock.vehicle, DiagnosisSettings(time_limit=0.01))
    assert found.baseline == "kinematic" and found.model is not None and found.model.baseline == "kinematic"
    assert any(r.startswith("the baseline is the kinematic model: ") for r in found.remarks)
    assert found.verdict == "unexplained" and not found.findings
    assert any("time limit" in remark for remark in found.remarks)
    not_tried = {u.effect for u in found.cannot_see if "not tried" in u.why}
    assert not_tried >= {"steering_scale", "speed_variation"}


def test_candidates_that_the_baseline_cannot_lack_are_refused(stock: rs.Runs):
    with pytest.raises(UsageError, match="none of roll_steer can be missing from the kinematic baseline"):
        rs.diagnose(stock, only=["roll_steer"])


@pytest.fixture(scope="module")
def tyred() -> rs.Runs:
    return rs.read(FIRMWARE / "defaults" / "run1.BIN", vehicle=DATA / "rover.toml")


@pytest.mark.parametrize(
    ("without", "unmeasured", "baseline", "why"),
    [
        ("", "", "roll-yaw", ""),
        ("p", "", "bicycle", "the roll rate does not follow the steering (it was not recorded)"),
        ("", "roll_inertia", "bicycle", "needs sprung_mass, cg_height_above_roll_centre and roll_inertia"),
    ],
)
def test_a_rover_with_tyres_is_diagnosed_with_them(
    tyred: rs.Runs, without: str, unmeasured: str, baseline: str, why: str
):
    assert tyred.vehicle is not None
    given = [run.without({without}) for run in tyred]
    geometry = geometry_of(tyred.vehicle)
    geometry = replace(geometry, **{unmeasured: None}) if unmeasured else geometry
    found = determined_model(grouped(given, Settings()), geometry)
    assert found[0] == baseline and why in found[1]


def test_a_baseline_that_lacks_roll_gives_way_to_one_with_it(tyred: rs.Runs, monkeypatch: pytest.MonkeyPatch):
    """One channel's coherence hid the roll that all channels together show: it is no left-out physics."""
    asked, limits = [], []

    def found(runs, rover, settings, *others):
        asked.append(settings.baseline)
        limits.append(settings.time_limit)
        effect = Finding("roll_dof", (), ByName(()), {}, (), "", "", "")
        return Diagnosis("explained", "", settings.baseline, findings=(effect,) if len(asked) == 1 else ())

    monkeypatch.setattr("rover_sweep.diagnosis.diagnose.diagnose", found)
    monkeypatch.setattr("rover_sweep.api.diagnosis_input.determined_model", lambda *_: ("bicycle", "no roll"))
    assert tyred.vehicle is not None
    answer = diagnosed(material(tuple(tyred), ()), tyred.vehicle, DiagnosisSettings(time_limit=60.0))
    assert limits[0] == 60.0 and 0.0 < limits[1] < 60.0  # one limit for both
    assert asked == ["bicycle", "roll-yaw"] and answer.baseline == "roll-yaw" and not answer.findings
    assert not any(r.startswith("the baseline is") for r in answer.remarks)
    diagnosed(material(tuple(tyred), ()), tyred.vehicle, DiagnosisSettings("bicycle"))
    assert asked[2:] == ["bicycle"]
