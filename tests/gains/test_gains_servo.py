"""Gains where the steering was commanded, measured or of unknown origin, from the same recorded drives."""

from __future__ import annotations

import copy
import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from csv_drives import DATA, DELAY, LAG, as_csv, column_map, vehicle_file

import rover_sweep as rs
from rover_sweep.cli.main import run
from rover_sweep.data.recording import AT_LOOP, Signal
from rover_sweep.data.vehicle_file import load
from rover_sweep.data.vehicle_geometry import geometry_of
from rover_sweep.diagnosis.result import Diagnosis, Fit, HeldOut
from rover_sweep.gains.identified import Identified, from_diagnosis, from_identification
from rover_sweep.gains.proposal import Proposal, assess_gains, family_of, propose_gains
from rover_sweep.gains.servo import servo_of
from rover_sweep.gains.steering_chain import autopilot, sampled_plant
from rover_sweep.identification.models import LAG as STEERING_LAG
from rover_sweep.identification.models import bicycle
from rover_sweep.report.identification.identification_json import identification_document

LOOP = autopilot({"SCHED_LOOP_RATE": 100.0, "INS_GYRO_FILTER": 20.0})
sys.path.insert(0, str(Path(__file__).parents[1] / "diagnosis"))
pytestmark = pytest.mark.usefixtures("few_corners")


@pytest.fixture(scope="module")
def identified(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """{origin in the column map: folder of the report}: "measured" are the wheels, the others the command."""
    folder, found = tmp_path_factory.mktemp("servo"), {}
    for origin in ("commanded", "measured", ""):
        files = as_csv(folder / (origin or "commanded"), measured=origin == "measured")
        read = {"vehicle": vehicle_file(folder, servo=False), "columns": str(column_map(folder, origin))}
        result = rs.identify(rs.read(*files, **read), models=["bicycle", "roll-yaw"], bootstrap=20)
        found[origin] = folder / f"report {origin}"
        result.report(found[origin])
    return found


def document(folder: Path) -> Any:
    return json.loads((folder / "identification.json").read_text())


def proposed(found: Identified) -> Proposal:
    return propose_gains(replace(found, intervals={}), LOOP, 2.5, at_once=True)


def test_a_measured_steering_with_its_servo_is_the_loop_of_the_command(identified: Any, tmp_path: Path):
    """The same within a few per cent. P and I are chosen from a grid in steps of 15 and 19 % where the loop
    hardly changes, so the loops are compared, and the gains of one on the plant of the other."""
    rover = load(vehicle_file(tmp_path, servo=True))
    found = {o: from_identification(document(identified[o]), None, rover) for o in ("commanded", "measured")}
    made = {o: proposed(f) for o, f in found.items()}
    one, two = (made[o].proposed for o in ("commanded", "measured"))
    assert one is not None and two is not None
    assert two.gains.ff == pytest.approx(one.gains.ff, rel=0.03)
    assert two.margins.crossover == pytest.approx(one.margins.crossover, rel=0.05)
    assert two.bandwidth == pytest.approx(one.bandwidth, rel=0.05)
    assert two.step.rise == pytest.approx(one.step.rise, rel=0.05)
    other = assess_gains(family_of(replace(found["measured"], intervals={}), LOOP, 2.5), one.gains)
    # the command's model has a delay in place of the servo's lag, which loses gain at 29 rad/s: 1.1 dB
    assert 0.0 < other.margins.gain_db - one.margins.gain_db < 1.5
    assert other.margins.phase_crossover == pytest.approx(one.margins.phase_crossover, rel=0.03)
    assert other.step.overshoot == pytest.approx(one.step.overshoot, abs=1.0)
    w = np.array([0.5, 2.0, 5.0, 10.0, 20.0])
    a, b = (sampled_plant(f.structure, 2.5, LOOP).response(w) for f in found.values() if f.structure)
    assert np.abs(b / a) == pytest.approx(np.ones(5), abs=0.08)
    assert np.degrees(np.angle(b / a)) == pytest.approx(np.zeros(5), abs=3.0)


def test_the_report_says_that_the_servo_is_in_the_loop(
    identified: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    rover = str(vehicle_file(tmp_path, servo=True))
    assert run(["gains", str(identified["measured"]), "--vehicle", rover]) == 0
    words = " ".join(capsys.readouterr().out.split())
    assert "the steering was measured, so the model has no servo: the loop includes 22 ms of lag" in words
    assert "(18.7 to 25.3 ms) and 15 ms of delay (13.4 to 16.6 ms), 90 % intervals" in words
    found = from_identification(document(identified["measured"]), None, load(rover))
    assert found.has_servo and found.intervals[STEERING_LAG.name] == pytest.approx((0.01871, 0.02529))
    lone = from_identification(document(identified["measured"]))
    assert found.structure and lone.structure and not lone.has_servo
    late = found.structure.values["tau"] - lone.structure.values["tau"]
    assert late == pytest.approx(DELAY) and found.structure.values[STEERING_LAG.name] == LAG


@pytest.mark.parametrize(
    ("origin", "words"),
    [
        (
            "measured",
            "because the steering was measured (angle), so the model begins behind the servo, without its "
            "lag: identify with the recorded command (without --servo-telemetry), or give the servo's lag",
        ),
        (
            "",
            "because it is unknown whether the steering was commanded or measured (angle), and a measured "
            "one lacks the servo: say it in the column map",
        ),
    ],
)
def test_without_a_command_and_a_servo_no_gains_are_computed(
    identified: Any, origin: str, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    out = tmp_path / "gains.param"
    asked = ["gains", str(identified[origin]), "--vehicle", str(vehicle_file(tmp_path, servo=False))]
    assert run([*asked, "--out", str(out)]) == 0
    said = capsys.readouterr()
    assert "No gains can be computed" in said.out and words in " ".join(said.out.split())
    assert "gain margin" not in said.out, "the present gains have no known margin either"
    assert "there are no gains to propose" in said.err and not out.exists()
    if not origin:  # a servo does not say what was recorded
        asked[-1] = str(vehicle_file(tmp_path, servo=True))
        assert run(asked) == 0 and words in " ".join(capsys.readouterr().out.split())


def test_the_servo_of_the_identifications_own_vehicle_file_is_enough(identified: Any, tmp_path: Path):
    changed = document(identified["measured"])
    lag = {"value": 0.022, "sd": None, "how": ""}
    changed["vehicle"]["steering"]["servo_lag"] = lag
    found = from_identification(changed)
    assert found.has_servo and not any("measured" in doubt for doubt in found.doubts)
    assert found.intervals[STEERING_LAG.name] == pytest.approx((0.7 * LAG, 1.3 * LAG)), "30 % without an sd"
    assert any("has no servo_delay" in remark for remark in found.remarks)
    changed["vehicle"]["steering"]["servo_rate_limit"] = {"value": 6.0, "sd": 0.2, "how": ""}
    assert any("rate limit is not included" in remark for remark in from_identification(changed).remarks)
    assert proposed(from_identification(changed)).proposed is not None


def test_a_servo_without_lag_is_a_delay():
    servo = servo_of(
        None, {"servo_lag": {"value": 0.0, "sd": 0.0}, "servo_delay": {"value": 0.02, "sd": 0.001}}
    )
    assert servo is not None
    structure = bicycle(geometry_of(load(DATA / "rover.toml"))).with_values({"tau": 0.005})
    made, intervals = servo.before(structure, {"tau": (0.004, 0.006)})
    assert made is not None and made.states == structure.states
    assert made.values["tau"] == pytest.approx(0.025)
    assert intervals["tau"] == pytest.approx((0.004 + 0.02 - 0.001645, 0.006 + 0.02 + 0.001645))


def test_an_older_file_and_mixed_runs_are_refused(identified: Any):
    commanded = document(identified["commanded"])
    assert from_identification(commanded).has_servo
    old, mixed, others = (copy.deepcopy(commanded) for _ in range(3))
    for one in old["runs"]:
        del one["channels"]["delta"]["origin"]
    (why,) = servo_words(from_identification(old))
    assert (
        "an older version of rover-sweep wrote this result" in why and "identify (or diagnose) again" in why
    )
    mixed["runs"][1]["channels"]["delta"]["origin"] = "measured"
    (why,) = servo_words(from_identification(mixed))
    assert "commanded in some runs and measured in others" in why
    others["verification_recordings"][0]["channels"]["delta"]["origin"] = "measured"
    assert not servo_words(from_identification(others)), "the model is of the fitted runs"


def servo_words(found: Identified) -> list[str]:
    assert found.has_servo == (not (words := [d for d in found.doubts if "measured" in d]))
    return words


def test_a_diagnosis_of_a_measured_steering_needs_the_servo_too(tmp_path: Path):
    from augmented_models import model

    kept = HeldOut("run4", Fit(3.0, 0.2), Fit(0.9, 0.05), 0.9)
    rover = load(vehicle_file(tmp_path, servo=True))
    command = model("tyre_relaxation")
    for origin, servo, level in (
        ("commanded", False, "gains"),
        ("measured", False, "none"),
        ("measured", True, "gains"),
        ("unknown", True, "none"),
        ("mixed", True, "none"),
        ("", True, "none"),
    ):
        changed = replace(command, steering_origin=origin)
        found = Diagnosis("explained", "all", changed.baseline, held_out=(kept,), model=changed)
        gains = from_diagnosis(found, rover if servo else None)
        assert propose_gains(gains, LOOP, 2.5).support.level == level, origin
        assert gains.has_servo == (level == "gains")
        assert bool(gains.structure and STEERING_LAG.name in gains.structure.values) == (
            origin == "measured" and servo
        )


def test_a_run_made_by_hand_says_its_origin_itself():
    """Without it, the refusal names the argument."""
    runs = rs.read(DATA / "ardurover-4.6.3" / "nominal" / "run1.BIN", vehicle=DATA / "rover.toml")
    for origin, refused in (("unknown", True), ("commanded", False)):
        own = {c: Signal(s.t, s.x, s.unit, "mine", s.hold) for c, s in runs[0].channels.items()}
        delta = replace(own["delta"], origin=origin)
        made = replace(runs[0], channels={**own, "delta": delta})
        result = rs.identify(replace(runs, recordings=(made,)), models=["bicycle"], bootstrap=0)
        found = from_identification(identification_document(result, result.origin), "bicycle")
        assert any('(in Python: Signal(..., origin="commanded"))' in d for d in found.doubts) == refused
    assert runs[0]["delta"].source.endswith(AT_LOOP)
