"""The embedded rover over TCP: what ArduPilot's rules let a ground station do."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from embedded_client import ROOT, Client, embedded
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.vehicle_parameters import ParameterStore
from sitl.embedded import listening_address, main, parser, prepare
from sitl.ground.server import UdpPeer

ACCEPTED, DENIED, UNSUPPORTED, FAILED = 0, 2, 3, 4
SERVO, RAW_IMU, ATTITUDE, ODOMETRY = 36, 27, 30, 331


@pytest.fixture(scope="module")
def port(tmp_path_factory: pytest.TempPathFactory) -> Iterator[int]:
    directory = tmp_path_factory.mktemp("rover")
    with embedded(directory, "--parameter", "RC6_OPTION=300") as number:
        yield number


@pytest.fixture
def client(port: int) -> Iterator[Client]:
    one = Client(port)
    one.wait("HEARTBEAT")
    one.override(c1=0, c2=0, c3=0, c4=0, c5=0, c6=0, c7=0, c8=0)
    yield one
    one.close()


def ready(client: Client) -> None:
    client.wait("SYSTEM_TIME", lambda m: m.time_boot_ms > 4000)


def test_heartbeat_is_an_ardurover_in_manual(client: Client) -> None:
    beat = client.wait("HEARTBEAT")
    assert (beat.type, beat.autopilot, beat.custom_mode, beat.base_mode) == (10, 3, 0, 65)


def test_version_says_that_it_is_embedded(client: Client) -> None:
    assert client.command(mavlink.MAV_CMD_REQUEST_MESSAGE, 148) == ACCEPTED
    client.send(mavlink.MAVLink_command_long_message(1, 1, 512, 0, 148, 0, 0, 0, 0, 0, 0))
    version = client.wait("AUTOPILOT_VERSION")
    assert version.flight_sw_version >> 8 == 0x040603
    client.send(mavlink.MAVLink_param_request_list_message(1, 1))
    assert "embedded" in client.wait_text("ArduRover V4.6.3")


def test_parameter_list_is_complete_and_numbered(client: Client) -> None:
    client.send(mavlink.MAVLink_param_request_list_message(1, 1))
    seen = {}
    for message in client.messages(5.0):
        if message.get_type() == "PARAM_VALUE":
            seen[message.param_index] = message.param_id
            if len(seen) == message.param_count:
                break
    assert sorted(seen) == list(range(len(seen)))
    assert {"SCHED_LOOP_RATE", "INS_GYRO_FILTER", "SERVO1_TRIM", "RC6_OPTION"} <= set(seen.values())
    assert "SCR_HEAP_SIZE" not in seen.values()  # hidden while SCR_ENABLE is 0


def test_parameters_are_float32_and_integers_are_cut(client: Client) -> None:
    assert client.set_parameter("FS_TIMEOUT", 1.1) == pytest.approx(1.1, rel=1e-7)
    assert client.read_parameter("FS_TIMEOUT").param_value != 1.1  # a float32
    assert client.set_parameter("INS_ACCEL_FILTER", 20.9) == 20
    assert client.read_parameter("INS_ACCEL_FILTER").param_type == 4
    client.set_parameter("INS_ACCEL_FILTER", 10)


def test_unknown_parameter_is_ignored(client: Client) -> None:
    client.send(mavlink.MAVLink_param_set_message(1, 1, b"NO_SUCH", 1.0, 9))
    client.send(mavlink.MAVLink_param_request_read_message(1, 1, b"NO_SUCH", -1))
    assert client.absent("PARAM_VALUE", 3000)


def test_rates_are_capped_by_the_loop_rate_of_50(client: Client) -> None:
    assert client.interval(SERVO, 25_000) == ACCEPTED
    assert client.interval(SERVO, 20_000) == DENIED
    client.wait_text("Increase SCHED_LOOP_RATE")
    assert client.command(mavlink.MAV_CMD_GET_MESSAGE_INTERVAL, SERVO) == ACCEPTED
    client.send(mavlink.MAVLink_command_long_message(1, 1, 510, 0, SERVO, 0, 0, 0, 0, 0, 0))
    assert client.wait("MESSAGE_INTERVAL").interval_us == 25_000  # the old rate stays
    times = [client.wait("SERVO_OUTPUT_RAW").time_usec for _ in range(41)]
    steps = sorted({round((b - a) / 1000) for a, b in zip(times, times[1:], strict=False)})
    assert steps == [20, 40]
    assert times[-1] - times[0] == pytest.approx(40 * 25_000, abs=20_000)


def test_odometry_is_denied_and_intervals_are_cut_to_ms(client: Client) -> None:
    assert client.interval(ODOMETRY, 100_000) == DENIED
    assert client.interval(ATTITUDE, 33_999) == ACCEPTED
    client.send(mavlink.MAVLink_command_long_message(1, 1, 510, 0, ATTITUDE, 0, 0, 0, 0, 0, 0))
    assert client.wait("MESSAGE_INTERVAL").interval_us == 33_000
    assert client.interval(ATTITUDE, -1) == ACCEPTED
    assert client.absent("ATTITUDE", 2000)


def test_raw_imu_is_in_milli_g_and_frd(client: Client) -> None:
    client.interval(RAW_IMU, 100_000)
    message = client.wait("RAW_IMU")
    assert -1030 < message.zacc < -970
    assert abs(message.xacc) < 30 and abs(message.zgyro) < 30


def test_override_moves_servos_only_from_the_pilots_system(port: int, client: Client) -> None:
    ready(client)
    client.interval(SERVO, 50_000)
    stranger = Client(port, system=245)
    for _ in range(3):
        stranger.override(c1=1700)
        assert client.wait("SERVO_OUTPUT_RAW").servo1_raw == 1500
    stranger.close()
    client.override(c1=1700)
    # dead zone 30 of 400 us, then 1500..1900
    assert client.wait("SERVO_OUTPUT_RAW", lambda m: m.servo1_raw != 1500).servo1_raw == 1500 + int(
        400 * 170 / 370
    )
    client.override(c1=0)
    client.wait("SERVO_OUTPUT_RAW", lambda m: m.servo1_raw == 1500)


def test_override_lapses_after_three_seconds(client: Client) -> None:
    ready(client)
    client.interval(SERVO, 50_000)
    client.override(c1=1900)
    began = client.wait("SERVO_OUTPUT_RAW", lambda m: m.servo1_raw == 1900).time_usec
    ended = client.wait("SERVO_OUTPUT_RAW", lambda m: m.servo1_raw == 1500).time_usec
    assert 2.8e6 < ended - began < 3.2e6


def test_throttle_moves_only_when_armed(client: Client) -> None:
    ready(client)
    client.interval(SERVO, 50_000)
    client.override(c3=1700)
    client.wait("RC_CHANNELS", lambda m: m.chan3_raw == 1700)
    assert client.wait("SERVO_OUTPUT_RAW").servo3_raw == 1500
    assert client.arm() == FAILED
    client.wait_text("Throttle (RC3) is not neutral")
    client.override(c3=1500)
    client.wait("RC_CHANNELS", lambda m: m.chan3_raw == 1500)
    assert client.arm() == ACCEPTED
    assert client.wait("HEARTBEAT").base_mode & 128
    client.override(c3=1700)
    client.wait("SERVO_OUTPUT_RAW", lambda m: m.servo3_raw > 1650)
    assert client.command(mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1) == FAILED  # not while armed
    assert client.arm(False) == ACCEPTED
    client.wait("SERVO_OUTPUT_RAW", lambda m: m.servo3_raw == 1500)


def test_modes_manual_and_hold(client: Client) -> None:
    ready(client)
    client.interval(SERVO, 50_000)
    client.override(c1=1900)
    client.wait("SERVO_OUTPUT_RAW", lambda m: m.servo1_raw == 1900)
    assert client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4) == ACCEPTED
    client.wait("SERVO_OUTPUT_RAW", lambda m: m.servo1_raw == 1500)
    assert client.wait("HEARTBEAT", lambda m: m.custom_mode == 4)
    assert client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 10) == FAILED
    assert client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 0) == ACCEPTED


def test_lost_radio_holds(client: Client) -> None:
    ready(client)
    client.set_parameter("SIM_RC_FAIL", 1)
    client.wait_text("Radio Failsafe")
    assert client.wait("HEARTBEAT", lambda m: m.custom_mode == 4).system_status == mavlink.MAV_STATE_CRITICAL
    assert client.arm() == FAILED
    receiver = mavlink.MAV_SYS_STATUS_SENSOR_RC_RECEIVER
    assert client.wait("SYS_STATUS", lambda m: not m.onboard_control_sensors_health & receiver)
    client.set_parameter("SIM_RC_FAIL", 0)
    client.wait_text("Radio Failsafe Cleared")
    assert client.wait("SYS_STATUS", lambda m: m.onboard_control_sensors_health & receiver)
    client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 0)


def test_switch_six_and_its_command(client: Client) -> None:
    ready(client)
    client.texts.clear()
    client.override(c6=1900)
    client.wait_text("function 300 HIGH")
    client.override(c6=1000)
    client.wait_text("function 300 LOW")
    assert client.command(mavlink.MAV_CMD_DO_AUX_FUNCTION, 300, 2) == ACCEPTED
    assert client.command(mavlink.MAV_CMD_DO_AUX_FUNCTION, 300, 3) == DENIED
    assert client.command(mavlink.MAV_CMD_DO_AUX_FUNCTION, 1, 2) == FAILED
    assert client.command(mavlink.MAV_CMD_NAV_TAKEOFF) == UNSUPPORTED


def test_position_appears_with_the_origin(client: Client) -> None:
    first = client.wait("LOCAL_POSITION_NED")
    assert first.time_boot_ms >= 10_000
    assert client.wait("GLOBAL_POSITION_INT", lambda m: m.lat != 0).lat == pytest.approx(-353632620, abs=2000)


def test_vehicle_time_waits_for_a_client_that_does_not_read(client: Client) -> None:
    ready(client)
    client.interval(RAW_IMU, 25_000)
    before_ms = client.wait("RAW_IMU").time_usec / 1e3
    time.sleep(0.5)  # some ten seconds of vehicle time at full speed
    client.send(mavlink.MAVLink_timesync_message(0, 77))
    answered_ms = client.wait("TIMESYNC", lambda m: m.ts1 == 77).tc1 / 1e6
    assert answered_ms - before_ms < 800  # 0.3 s, and what the client had fetched already


def test_failsafe_without_a_ground_station(client: Client) -> None:
    ready(client)
    client.set_parameter("FS_GCS_ENABLE", 1)
    client.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3))
    client.wait_text("Failsafe")  # "Radio Failsafe" even: the firmware names whichever check comes first
    client.wait("HEARTBEAT", lambda m: m.custom_mode == 4)
    client.set_parameter("FS_GCS_ENABLE", 0)
    client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 0)


def test_a_lost_ground_station_is_gone_for_real_time(port: int, client: Client) -> None:
    client.interval(RAW_IMU, 25_000)
    left_us = client.wait("RAW_IMU").time_usec
    client.close()
    time.sleep(0.6)
    back = Client(port)
    back.interval(RAW_IMU, 25_000)
    assert 0.5e6 < back.wait("RAW_IMU").time_usec - left_us < 2.0e6
    back.close()


def test_speedup(tmp_path: Path) -> None:
    with embedded(tmp_path, "--speedup", "5") as number:
        client = Client(number)
        client.interval(RAW_IMU, 100_000)
        ratios = []
        for _ in range(3):  # a busy machine delays a message, so one of three may be off
            first, began = client.wait("RAW_IMU").time_usec, time.monotonic()
            last = client.wait("RAW_IMU", lambda m, t=first: m.time_usec > t + 3_000_000).time_usec
            ratios.append((last - first) * 1e-6 / (time.monotonic() - began))
        assert sorted(ratios)[1] == pytest.approx(5.0, rel=0.15)
        client.close()


def test_reboot_drops_the_connection_and_changes_the_loop_rate(tmp_path: Path) -> None:
    with embedded(tmp_path) as port:
        client = Client(port)
        client.wait("HEARTBEAT")
        assert client.set_parameter("SCHED_LOOP_RATE", 400) == 400
        assert client.interval(SERVO, 10_000) == DENIED  # not before the reboot
        assert client.command(mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1) == ACCEPTED
        with pytest.raises(ConnectionResetError):
            list(client.messages(5.0))
        client = Client(port)
        client.wait("HEARTBEAT")
        assert client.read_parameter("SCHED_LOOP_RATE").param_value == 400
        assert client.interval(SERVO, 3_000) == ACCEPTED
        times = [client.wait("SERVO_OUTPUT_RAW").time_usec for _ in range(31)]
        assert times[-1] - times[0] == pytest.approx(90_000, abs=3000)
        client.close()


# ---- The embedded rover over UDP, its command line, and how it ends.


def test_udp_sends_first_and_hears_the_answer(tmp_path: Path) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ground:
        ground.bind(("127.0.0.1", 0))
        ground.settimeout(10.0)
        target = f"127.0.0.1:{ground.getsockname()[1]}"
        command = [sys.executable, "-m", "sitl.embedded", "--udp", target, "--directory", str(tmp_path)]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT) as program:
            try:
                assert program.stdout is not None
                assert json.loads(program.stdout.readline()) == {
                    "tcp": None,
                    "udp": target,
                    "directory": str(tmp_path),
                }
                mav = mavlink.MAVLink(None, srcSystem=255)
                kinds: list[str] = []
                asked = False
                while "PARAM_VALUE" not in kinds:
                    data, vehicle = ground.recvfrom(65536)
                    assert vehicle[0] == "127.0.0.1"
                    kinds += [m.get_type() for m in mav.parse_buffer(data) or []]
                    if not asked:
                        read = mavlink.MAVLink_param_request_read_message(1, 1, b"SYSID_MYGCS", -1)
                        ground.sendto(read.pack(mav), vehicle)
                        asked = True
                assert "HEARTBEAT" in kinds
            finally:
                program.terminate()
        assert program.returncode == 0


def test_a_rover_that_nobody_talks_to_waits_without_working_and_ends_on_sigterm(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "sitl.embedded", "--directory", str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT) as program:
        assert program.stdout is not None
        assert json.loads(program.stdout.readline())["tcp"] > 0
        time.sleep(0.3)
        program.terminate()
        assert program.wait(3.0) == 0
    assert list((tmp_path / "logs").iterdir()) == []


def test_nothing_is_bound_beyond_loopback_unless_told() -> None:
    assert listening_address(parser().parse_args([])) == ("127.0.0.1", 0)
    assert listening_address(parser().parse_args(["--udp", "127.0.0.1:14550"])) is None
    assert listening_address(parser().parse_args(["--tcp", "0.0.0.0:5760"])) == ("0.0.0.0", 5760)
    peer = UdpPeer(("127.0.0.1", 14550))
    assert peer.connection.getsockname()[0] == "127.0.0.1"
    peer.close()


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--parameter", "NO_SUCH=1"], "has no parameter NO_SUCH"),
        (["--variant", "flying"], "no variant flying"),
    ],
)
def test_wrong_usage_gets_one_sentence_and_code_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], sentence: str
) -> None:
    assert main(["--directory", str(tmp_path), *options]) == 2
    errors = capsys.readouterr().err.splitlines()
    assert len(errors) == 1 and sentence in errors[0]


def test_prepare_brings_the_applet_and_the_parameters(tmp_path: Path) -> None:
    prepare(tmp_path, True, [("SCR_ENABLE", 1.0)])
    assert "SWP_" in (tmp_path / "scripts" / "rover_sweep.lua").read_text()
    assert ParameterStore(tmp_path / "parameters.txt")["SCR_ENABLE"] == 1
