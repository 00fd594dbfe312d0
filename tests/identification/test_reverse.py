"""Runs in reverse: a negative speed is a speed. The simulated rover's numbers are known."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from synthetic import GEOMETRY, TRUE

import rover_sweep as rs
from rover_sweep.api.gains import steering_gains
from rover_sweep.cli.driving.simulated import rover_text, truth
from rover_sweep.identification.models import bicycle, roll_yaw
from rover_sweep.manoeuvre.sweep import Sweep
from rover_sweep.session.content import SessionRun
from rover_sweep.session.simulated_rover import SimulatedRover, simulated_plan, simulated_session
from rover_sweep.vehicle.events import LogSaved
from sitl.plant.variant import PlantParameters, load_variant
from sitl.redrive.course import Course
from sitl.redrive.open_loop import redrive

SWEEP = Sweep(amplitude=150, w_min=1, w_max=22, t_rec=25)
STILL = 4.0  # s, before the drive and at full speed before the sweep
NOMINAL = load_variant("nominal")
OUTPUT = {"FUNCTION": 26.0, "TRIM": 1500.0, "MIN": 1100.0, "MAX": 1900.0}


def driven(
    path: Path, speed: float, rover: PlantParameters = NOMINAL, seed: int = 1, off: float = 0.0
) -> str:
    """The log of a sweep of the simulated rover; off: its linkage's trim beside that of the servo [us]."""
    t = np.arange(0.0, SWEEP.duration + 3 * STILL, 0.005)
    wave = SWEEP.wave(np.clip(t - 2 * STILL, 0.0, SWEEP.duration - 1e-6))
    steering = 1500.0 + np.round(np.where(t > 2 * STILL, wave, 0.0))
    v = speed * np.clip((t - STILL) / 2, 0.0, 1.0)
    parameters = {"INS_GYRO_FILTER": 20.0, "INS_ACCEL_FILTER": 10.0}
    parameters |= {f"SERVO1_{name}": value for name, value in OUTPUT.items()}
    rover = replace(rover, steering_trim_us=rover.steering_trim_us + off)
    redrive(Course(t, steering, v, t, steering, parameters=parameters), rover, path, seed)
    return str(path)


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    home = tmp_path_factory.mktemp("ways")
    (home / "rover.toml").write_text(rover_text("nominal"), encoding="utf-8")
    driven(home / "ahead.BIN", 2.5)
    driven(home / "back.BIN", -2.5, seed=2)
    return home


def found(home: Path, *names: str) -> rs.Result:
    runs = rs.read(*(str(home / f"{name}.BIN") for name in names), vehicle=str(home / "rover.toml"))
    return rs.identify(runs, models=["roll-yaw"], tied=False, bootstrap=20)


@pytest.fixture(scope="module")
def both(home: Path) -> rs.Result:
    return found(home, "ahead", "back")


@pytest.fixture(scope="module")
def back(home: Path) -> rs.Result:
    return found(home, "back")


@pytest.mark.parametrize("make", [bicycle, roll_yaw])
def test_reverse_is_a_rover_turned_about(make) -> None:  # type: ignore[no-untyped-def]
    """Forwards, with the axles exchanged and steered at the rear, the yaw rate is the same.

    Seen from behind, lengths, sideslip and steering angle change their sign, and the rear steers by -delta.
    """
    geometry = replace(GEOMETRY, imu_x=0.0)
    there = make(geometry, tied=False).with_values({**TRUE, "Cf": 28.0, "Cr": 35.0})
    swapped = replace(geometry, a=geometry.b, b=geometry.a)
    back = make(swapped, tied=False).with_values({**TRUE, "Cf": 35.0, "Cr": 28.0})
    one, two = there.matrices(-2.4), back.matrices(2.4)
    (a, *_), (turned, *_) = one.state_space(), two.state_space()
    assert np.sort_complex(np.linalg.eigvals(a)) == pytest.approx(np.sort_complex(np.linalg.eigvals(turned)))
    steady = one.state_space()[2] @ np.linalg.solve(-a, one.state_space()[1])
    base, k = geometry.wheelbase, geometry.mass / geometry.wheelbase * (geometry.b / 28 - geometry.a / 35)
    r = there.outputs.index("r")
    assert steady[r, 0] == pytest.approx(-2.4 / (base - k * 2.4**2), rel=1e-6)


def test_runs_in_reverse_alone(back: rs.Result) -> None:
    result = back
    assert result.speed == pytest.approx(-2.5, abs=0.03) and result.recommended == "roll-yaw"
    fitted = result.models["roll-yaw"].parameters
    for name in ("Cf", "Cr", "Izz", "k_phi", "b_phi", "tau"):
        low, high = fitted[name].interval_90 or (0.0, 0.0)
        assert low < truth(NOMINAL)[name] < high, name
    assert any("driven in reverse" in words for words in result.summary) and not len(result.numbers)
    assert not result.both_ways


def test_both_ways_agree_on_a_sound_rover(both: rs.Result) -> None:
    assert [group.speed < 0 for group in both.groups] == [False, True]
    pairs = {pair.forward.name: pair for pair in both.both_ways}
    assert {"Cf", "Cr", "Izz", "tau", "gain", "trim", "yaw_damping"} <= pairs.keys()
    true = truth(NOMINAL) | {"gain": 1.0, "trim": 0.0}
    for name in true.keys() & pairs.keys():
        for one in (pairs[name].forward, pairs[name].reverse):
            assert one.low is not None and one.high is not None
            assert one.low - 1e-3 < true[name] < one.high + 1e-3, name
    assert not any(pair.differs for pair in both.both_ways if not pair.expected)
    assert any("agree within their intervals in Cf, Cr" in words for words in both.summary)
    assert len(both.numbers)  # of the forward run


def test_the_report_has_both_ways(both: rs.Result, tmp_path: Path) -> None:
    files = both.report(tmp_path / "report")
    page = files.page.read_text(encoding="utf-8")
    assert "Forward and reverse" in page
    document = json.loads((tmp_path / "report" / "identification.json").read_text(encoding="utf-8"))
    told = {row["name"]: row for row in document["forward_and_reverse"]}
    assert told["Cf"]["differs"] is False and told["Cf"]["reverse"]["value"] > 0
    assert rs.load_result(both.save(tmp_path / "result.json")).both_ways == both.both_ways


def test_a_rover_that_differs_in_reverse(home: Path, tmp_path: Path) -> None:
    """Its front tyres hold a third less in reverse, and its wheels then stand 20 us to one side."""
    soft = replace(NOMINAL, front_cornering_stiffness=20.0)
    driven(tmp_path / "soft.BIN", -2.5, soft, seed=3, off=20.0)
    for name in ("ahead.BIN", "rover.toml"):
        (tmp_path / name).symlink_to(home / name)
    result = found(tmp_path, "ahead", "soft")
    apart = {pair.forward.name for pair in result.both_ways if pair.differs and not pair.expected}
    assert {"Cf", "trim"} <= apart
    trim = next(pair for pair in result.both_ways if pair.forward.name == "trim")
    assert trim.reverse.value == pytest.approx(-20 * NOMINAL.rad_per_us, rel=0.25)
    (words,) = (words for words in result.summary if "differ by more than their intervals" in words)
    assert "Cf" in words and "identify each way alone" in words


def test_others_refuse_or_leave_out_reverse(home: Path, back: rs.Result, tmp_path: Path) -> None:
    vehicle = str(home / "rover.toml")
    refused = rs.diagnose(rs.read(str(home / "back.BIN"), vehicle=vehicle))
    assert refused.verdict == "refused" and "back was driven in reverse (-2." in refused.sentence
    back.report(tmp_path / "alone")
    proposal = steering_gains(tmp_path / "alone", None, vehicle, {}, "", None)
    assert proposal.support.level == "none" and "driven in reverse" in " ".join(proposal.support.reasons)


def test_the_applet_sweeps_in_reverse(home: Path, tmp_path: Path) -> None:
    """With a throttle below trim: the applet's speed is over ground, and the log's is along the heading."""
    simulation = SimulatedRover(prepared=False)
    runs = (SessionRun("back", Sweep(amplitude=150, w_min=1, w_max=20, t_rec=10)),)
    plan = simulated_plan(runs, simulation)
    plan = replace(plan, settings=replace(plan.settings, throttle_us=1290))
    with simulated_session(simulation, plan, tmp_path) as (events, _):
        (log,) = [event.path for event in events if isinstance(event, LogSaved)]
    (run,) = rs.read(str(log), vehicle=str(home / "rover.toml"))
    assert run.kind == "sweep" and run.mean_speed == pytest.approx(-2.3, abs=0.2)
    assert not [note.text for note in run.notes if note.level == "warning"]
