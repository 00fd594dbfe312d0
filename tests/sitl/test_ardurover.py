"""The real firmware on the JSON physics: aligns, arms, drives, turns; its estimator agrees with the truth."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from math import degrees
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from running_programs import all_run

from sitl.launcher import LaunchError, find_ardurover, start_ardurover

pytestmark = pytest.mark.ardurover

PARAMETERS = """SCHED_LOOP_RATE 100
INS_GYRO_FILTER 20
INS_ACCEL_FILTER 20
RC_OVERRIDE_TIME 10
SERVO1_MIN 1000
SERVO1_MAX 2000
SERVO3_MIN 1000
SERVO3_MAX 2000
RC1_MIN 1000
RC1_MAX 2000
RC3_MIN 1000
RC3_MAX 2000
RC1_DZ 0
RC3_DZ 0
"""
ALIGNED = 0x8 | 0x10  # EKF_STATUS_REPORT flags: horizontal position, relative and absolute
SPEEDUP = 15.0
STRAIGHT, RIGHT, END = 8.0, 12.0, 14.0  # s of the drive at which each part is over


@dataclass(frozen=True)
class Drive:
    """rows (n, 6): t [s], roll, yaw [rad], yaw rate [rad/s] (FRD), ground speed [m/s], worst EKF variance."""

    rows: np.ndarray
    truth: np.ndarray
    directory: Path


@pytest.fixture(scope="module")
def binary() -> Path:
    try:
        return find_ardurover()
    except LaunchError as error:
        pytest.skip(str(error))


@pytest.fixture(scope="module")
def drive(binary: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Drive]:
    from pymavlink import mavutil

    directory = tmp_path_factory.mktemp("ardurover")
    defaults = directory / "defaults.param"
    defaults.write_text(PARAMETERS)
    with start_ardurover(
        binary, directory, speedup=SPEEDUP, defaults=[defaults], physics_rate=400.0
    ) as rover:
        link = mavutil.mavlink_connection(rover.connection, source_system=255)
        try:
            rows = np.array(list(recorded(link)))
        finally:
            link.close()
    yield Drive(rows, np.genfromtxt(directory / "truth.csv", delimiter=",", names=True), directory)


def recorded(link: Any) -> Iterator[tuple[float, ...]]:
    """Arm when the estimator has a position, drive straight, right, straight; all by the vehicle's clock."""
    link.wait_heartbeat(timeout=20)
    link.mav.request_data_stream_send(1, 1, 0, 20, 1)
    start, asked, speed, worst = None, -10.0, 0.0, 0.0
    deadline = time.monotonic() + 60.0
    while time.monotonic() < deadline:
        message = link.recv_match(type=["ATTITUDE", "VFR_HUD", "EKF_STATUS_REPORT"], blocking=True, timeout=5)
        assert message is not None, "the firmware fell silent"
        kind = message.get_type()
        if kind == "VFR_HUD":
            speed = message.groundspeed
        elif kind == "EKF_STATUS_REPORT":
            worst = max(message.velocity_variance, message.pos_horiz_variance, message.compass_variance)
            if start is None and message.flags & ALIGNED == ALIGNED and not link.motors_armed():
                link.mav.command_long_send(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)
        else:
            now = message.time_boot_ms * 1e-3
            if start is None and link.motors_armed():
                start = now
            into = -1.0 if start is None else now - start
            if now - asked > 0.1:
                asked = now
                steer = 1650 if STRAIGHT < into < RIGHT else 1500
                link.mav.rc_channels_override_send(
                    1, 1, steer, 1500, 1710 if into > 0 else 1500, 1500, 1000, 1000, 0, 0
                )
            if into > END:
                return
            if into >= 0:
                yield into, message.roll, message.yaw, message.yawspeed, speed, worst
    pytest.fail("the drive did not end within a minute")


def test_drives_straight_at_the_speed_of_the_throttle(drive: Drive) -> None:
    t, _, yaw, _, speed, _ = drive.rows.T
    before = (t > STRAIGHT - 1.5) & (t < STRAIGHT)
    assert np.mean(speed[before]) == pytest.approx(2.5, abs=0.12)
    assert degrees(np.ptp(yaw[before])) < 8


def test_larger_pwm_turns_right_and_leans_left(drive: Drive) -> None:
    t, roll, _, rate, _, _ = drive.rows.T
    turning = (t > STRAIGHT + 1.5) & (t < RIGHT)
    assert np.mean(rate[turning]) == pytest.approx(0.86, abs=0.06)
    assert np.mean(roll[turning]) == pytest.approx(-0.031, abs=0.01)


def test_estimator_does_not_diverge(drive: Drive) -> None:
    assert np.max(drive.rows[:, 5]) < 0.5


def test_yaw_rate_agrees_with_the_truth(drive: Drive) -> None:
    """The same turn, right positive, from the plant's own record; the clocks differ by the boot."""
    turning = np.flatnonzero(drive.truth["pwm"] == 1650)
    true_rate = -drive.truth["r"][turning[75] : turning[-1]]
    t, _, _, rate, _, _ = drive.rows.T
    assert np.mean(rate[(t > STRAIGHT + 1.5) & (t < RIGHT)]) == pytest.approx(np.mean(true_rate), abs=0.02)


def test_own_rover_model_starts(binary: Path, tmp_path: Path) -> None:
    from pymavlink import mavutil

    with start_ardurover(binary, tmp_path, variant=None) as rover:
        link = mavutil.mavlink_connection(rover.connection, source_system=255)
        heartbeat = link.wait_heartbeat(timeout=10)
        link.close()
    assert heartbeat is not None and heartbeat.type == mavutil.mavlink.MAV_TYPE_GROUND_ROVER
    assert not all_run(rover)
