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

from sitl.embedded import listening_address, main, parser
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


def test_it_is_an_ardurover_in_manual_that_says_that_it_is_embedded(client: Client) -> None:
    beat = client.wait("HEARTBEAT")
    assert (beat.type, beat.autopilot, beat.custom_mode, beat.base_mode) == (10, 3, 0, 65)
    client.send(mavlink.MAVLink_command_long_message(1, 1, 512, 0, 148, 0, 0, 0, 0, 0, 0))
    assert client.wait("AUTOPILOT_VERSION").flight_sw_version >> 8 == 0x040603
    client.send(mavlink.MAVLink_param_request_list_message(1, 1))
    assert "embedded" in client.wait_text("ArduRover V4.6.3")
    assert client.wait("LOCAL_POSITION_NED").time_boot_ms >= 10_000  # with the origin
    assert client.wait("GLOBAL_POSITION_INT", lambda m: m.lat != 0).lat == pytest.approx(-353632620, abs=2000)


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
    client.send(mavlink.MAVLink_param_set_message(1, 1, b"NO_SUCH", 1.0, 9))
    client.send(mavlink.MAVLink_param_request_read_message(1, 1, b"NO_SUCH", -1))
    assert client.absent("PARAM_VALUE", 1000)


def test_odometry_is_denied_and_intervals_are_cut_to_ms(client: Client) -> None:
    assert client.interval(ODOMETRY, 100_000) == DENIED
    assert client.interval(ATTITUDE, 33_999) == ACCEPTED
    client.send(mavlink.MAVLink_command_long_message(1, 1, 510, 0, ATTITUDE, 0, 0, 0, 0, 0, 0))
    assert client.wait("MESSAGE_INTERVAL").interval_us == 33_000
    assert client.interval(ATTITUDE, -1) == ACCEPTED
    assert client.absent("ATTITUDE", 500)


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
    assert client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 10) == FAILED
    assert client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4) == ACCEPTED
    assert client.wait("HEARTBEAT", lambda m: m.custom_mode == 4)
    assert client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 0) == ACCEPTED


def test_vehicle_time_waits_for_a_client_that_does_not_read(client: Client) -> None:
    ready(client)
    client.interval(RAW_IMU, 25_000)
    before_ms = client.wait("RAW_IMU").time_usec / 1e3
    time.sleep(0.5)  # some ten seconds of vehicle time at full speed
    client.send(mavlink.MAVLink_timesync_message(0, 77))
    answered_ms = client.wait("TIMESYNC", lambda m: m.ts1 == 77).tc1 / 1e6
    assert answered_ms - before_ms < 800  # 0.3 s, and what the client had fetched already


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
                said = json.loads(program.stdout.readline())
                assert said == {"tcp": None, "udp": target, "directory": str(tmp_path)}
                mav, kinds = mavlink.MAVLink(None, srcSystem=255), list[str]()
                while "PARAM_VALUE" not in kinds:
                    data, vehicle = ground.recvfrom(65536)
                    if not kinds:
                        read = mavlink.MAVLink_param_request_read_message(1, 1, b"SYSID_MYGCS", -1)
                        ground.sendto(read.pack(mav), vehicle)
                    kinds += [m.get_type() for m in mav.parse_buffer(data) or []]
                assert "HEARTBEAT" in kinds
            finally:
                program.terminate()
        assert program.returncode == 0


def test_a_rover_that_nobody_talks_to_waits_without_working_and_ends_on_sigterm(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "sitl.embedded", "--directory", str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT) as program:
        assert program.stdout is not None
        assert json.loads(program.stdout.readline())["tcp"] > 0
        time.sleep(0.1)
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
