"""What a bench measured, in the hands of identification and diagnosis: no longer found, nor mistaken."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from synthetic_servo import VARIANT

import rover_sweep as rs
from rover_sweep.api.diagnosis_input import diagnosed, material
from rover_sweep.api.investigation import plan_runs
from rover_sweep.api.known_steering import FINE, behind_servo, has_linkage, known, through_linkage
from rover_sweep.cli.main import run
from rover_sweep.data.geometry import Tolerances
from rover_sweep.data.recording import Signal
from rover_sweep.data.vehicle_file import Measured, load
from rover_sweep.data.vehicle_geometry import tolerances_of
from rover_sweep.diagnosis.effects import library
from rover_sweep.diagnosis.plans.planner import PlannedRun, Planner
from rover_sweep.diagnosis.result import DiagnosisSettings
from rover_sweep.logs.read import read_logs, read_runs
from rover_sweep.redrive.recorded_course import course_of, on_the_clock
from rover_sweep.report.identification.identification_json import identification_document
from sitl.plant.servo import Servo
from sitl.plant.variant import load_variant
from sitl.redrive.open_loop import redrive

ROOT = Path(__file__).parents[2]
DRIVEN = ROOT / "tests" / "data" / "ardurover-4.6.3" / "nominal"
ROVER = ROOT / "tests" / "data" / "rover.toml"
NAMED = (
    "steering_backlash", "steering_asymmetry", "steering_deadband", "steering_nonlinearity", "servo_lag",
    "servo_rate_limit", "suspension_friction", "tyre_saturation", "load_transfer",
)  # fmt: skip
OnBlocks = Callable[..., str]


def test_a_file_without_bench_values_changes_nothing(monkeypatch: pytest.MonkeyPatch):
    """The runs are the same objects, and the diagnosis is asked what it was asked before."""
    vehicle, asked = load(ROVER), []
    one = rs.read(DRIVEN / "run1.BIN", vehicle=ROVER)[0]
    assert not has_linkage(vehicle)
    assert through_linkage(one, vehicle) is one
    spread = tolerances_of(vehicle)
    assert known(vehicle, spread).spread is spread
    assert not known(vehicle, spread).settled

    def seen(*given: Any) -> Any:
        asked.append(given)
        raise KeyboardInterrupt

    monkeypatch.setattr("rover_sweep.diagnosis.diagnose.diagnose", seen)
    settings = DiagnosisSettings("roll-yaw", without_effects=("roll_steer",))
    with pytest.raises(KeyboardInterrupt):
        diagnosed(material([one], []), vehicle, settings)
    assert asked[0][0][0] is one
    assert asked[0][2] == replace(settings, spread=spread)


def test_a_linear_servo_driven_by_it_turns_the_wheels_as_the_real_one():
    """Rate limit and play behind the lag, against the simulation's servo, which shares no code with it."""
    rng = np.random.default_rng(4)
    t = np.append(0.0, np.cumsum(rng.uniform(0.008, 0.014, 900)))
    pwm = 1500 + np.round(200 * np.sin(2 * np.pi * (0.3 * t + 0.15 * t**2)))
    play = {"steering_backlash": {"b": 0.012}}
    numbers = {"servo_lag": 0.035, "servo_rate_limit": 2.0, "servo_delay": 0.0}
    rover = replace(load_variant("nominal"), effects=play, **numbers)
    command = Signal(t, -(pwm - 1500) * rover.rad_per_us, "rad", hold=True)
    asked = behind_servo(command, 0.035, 1 / 2.0, 0.012)
    real = Servo(rover)
    follows = Servo(replace(rover, servo_rate_limit=1e3, steering_limit=10.0, effects={}))
    one = np.array(_turned(real, t, pwm, asked.t))
    two = np.array(_turned(follows, asked.t, 1500 - asked.x / rover.rad_per_us, asked.t))
    assert np.abs(one).max() > 0.1
    assert np.abs(one - two).max() < 1e-9
    assert np.diff(asked.t).max() <= FINE + 1e-9


def _turned(servo: Servo, t: np.ndarray, pwm: np.ndarray, at: np.ndarray) -> list[float]:
    """Angles [rad] at some times, each command taken when it comes."""
    now, j, out = 0.0, 0, []
    for end in at.tolist():
        while j < t.size and t[j] < end:
            servo.command(float(pwm[j]), float(t[j]))
            j += 1
        out.append(servo.advance(now, end))
        now = end
    return out


def test_what_is_known_is_no_candidate_and_what_is_not_stays_one():
    """Settled where what the measurement leaves open is less than what would count as a finding."""
    some = {"backlash": Measured(0.01, 0.0002), "asymmetry": Measured(0.05, 0.2)}
    more = {"servo_rate_limit": Measured(3.0, 0.1), "deadband": Measured(0.001)}
    vehicle = replace(load(ROVER), **some, **more)
    found = known(vehicle, Tolerances())
    assert set(found.settled) == {"steering_backlash", "servo_rate_limit"}
    assert "0.01 ± 0.0002 rad" in found.settled["steering_backlash"]
    assert found.spread == Tolerances()
    slow = known(replace(vehicle, servo_lag=Measured(0.03, 0.001), material={}), Tolerances())
    assert "servo_lag" in slow.settled
    assert slow.spread.lag == pytest.approx(1.25 * 0.03 + 0.002)
    assert slow.spread.together - Tolerances().together == pytest.approx(slow.spread.lag - Tolerances().lag)
    by_hand = replace(vehicle, servo_lag=Measured(0.03, 0.001), material={"servo_lag": 0.06})
    assert known(by_hand, tolerances_of(by_hand)).spread.lag == 0.06


def test_a_steering_that_was_logged_slowly_is_taken_through_curve_and_play_alone():
    vehicle = replace(load(ROVER), backlash=Measured(0.01), servo_lag=Measured(0.03), asymmetry=Measured(0.1))
    one = rs.read(DRIVEN / "run1.BIN", vehicle=ROVER)[0]
    delta = one["delta"]
    slow = replace(one, channels={**one.channels, "delta": replace(delta, t=delta.t[::8], x=delta.x[::8])})
    assert through_linkage(one, vehicle)["delta"].rate > 300
    through = through_linkage(slow, vehicle)["delta"]
    assert through.t is slow["delta"].t
    assert through.x.max() == pytest.approx(1.1 * slow["delta"].x.max() - 0.01, abs=1e-3)
    curved = through_linkage(slow, replace(vehicle, backlash=None))["delta"]
    assert curved.x == pytest.approx(slow["delta"].x + 0.1 * np.abs(slow["delta"].x))


def test_an_identification_fits_closer_with_the_bench_and_tells_of_it(tmp_path: Path):
    """Play looks like delay: the plant's lag and delay are some 0.045 s where it is swept, and without
    the bench some 0.008 s more are found."""
    variant, plain, benched = (tmp_path / name for name in ("variant.toml", "plain.toml", "rover.toml"))
    variant.write_text(VARIANT)
    plain.write_text(ROVER.read_text())
    bench = "asymmetry = 0.05\nbacklash = 0.012\nservo_lag = 0.035\nservo_rate_limit = 3.0\n\n[imu]"
    benched.write_text(ROVER.read_text().replace("[imu]", bench))
    sweep, cost, tau, told = driven(variant, tmp_path), [], [], []
    for file in (plain, benched):
        result = rs.identify(rs.read(sweep, vehicle=file), models=["bicycle"], bootstrap=0)
        document = identification_document(result, result.origin)
        cost.append(document["models"]["bicycle"]["cost"]["average"])
        tau.append(document["models"]["bicycle"]["parameters"]["tau"]["value"])
        told.append(document["vehicle"]["steering"])
    assert set(told[0]) == {"trim_us", "rad_per_us"}
    assert told[1]["backlash"]["value"] == 0.012
    assert cost[1] < 0.8 * cost[0]
    assert abs(tau[1] - 0.045) < 0.004 < abs(tau[0] - 0.045)


def test_a_plan_no_longer_asks_for_what_the_bench_settled(monkeypatch: pytest.MonkeyPatch):
    asked: list[Any] = []
    monkeypatch.setattr("rover_sweep.diagnosis.plans.plan.plan", lambda *given: asked.append(given))
    vehicle = load(ROVER)
    benched = replace(vehicle, backlash=Measured(0.01, 0.0002), deadband=Measured(0.0, 0.0001))
    runs = [PlannedRun("sweep", 120.0, 2.4)]
    for rover, wanted in ((vehicle, ()), (benched, ()), (benched, ("steering_backlash",))):
        plan_runs(runs, rover, wanted, progress=lambda what, share: None)
    both = {"steering_backlash", "steering_deadband"}
    assert [set(given[-1]) for given in asked] == [set(), both, {"steering_deadband"}]
    _, rover, scale, _, wanted, spread, driven, progress, settled = asked[1]
    plain, planner = (Planner(rover, scale, wanted, spread, driven, progress, s) for s in ({}, settled))
    assert set(plain.asked) - set(planner.asked) == set(settled)
    why = {u.effect: u.why for u in planner.unseen(runs, ())}
    assert "the bench measured backlash 0.01" in why["steering_backlash"]


def driven(variant: Path, folder: Path) -> str:
    """The steering of a recorded sweep through the plant of a variant, recorded."""
    source, out = str(DRIVEN / "run2.BIN"), folder / "driven.BIN"
    redrive(course_of(read_logs(source)[0]), on_the_clock(load_variant(variant), read_runs(source)), out, 2)
    return str(out)


@pytest.mark.slow
def test_a_bench_takes_the_look_alikes_out_of_a_diagnosis(
    on_blocks: OnBlocks, vehicle_toml: Path, tmp_path: Path
):
    """Play, an uneven gain and a slow servo are found; benched, only the usual bend of tyres is left."""
    wheel, without = tmp_path / "imu.csv", tuple(effect for effect in library() if effect not in NAMED)
    url = on_blocks("--wheel", str(wheel))  # writes the variant as well
    sweep = driven(tmp_path / "variant.toml", tmp_path)
    hidden = rs.diagnose(rs.read(sweep, vehicle=vehicle_toml), without=without)
    assert "steering_backlash" in {f.effect for f in hidden.findings} and len(hidden.findings) > 1

    asked = f"bench --connect {url} --wheel-imu {wheel} --wheel-clock vehicle --yes --steps 100,250"
    assert run([*asked.split(), "--out", str(tmp_path / "bench"), "--vehicle", str(vehicle_toml)]) == 0
    found = rs.diagnose(rs.read(sweep, vehicle=vehicle_toml), without=without)
    assert found.verdict == "none" and not found.findings
    told = " ".join(found.remarks)
    for effect in ("steering_backlash", "steering_asymmetry", "servo_rate_limit", "servo_lag"):
        assert f"{effect} was not looked for: the bench measured" in told
