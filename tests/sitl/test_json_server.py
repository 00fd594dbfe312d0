"""JSON physics: the datagrams of the firmware, lock-step, restarts, and the line that it can parse."""

from __future__ import annotations

import json
import re
import socket
import struct
import threading
from io import StringIO
from math import sin

import numpy as np
import pytest

from sitl.json_server import LOOPBACK, Physics, ServoFrame, main, parse_request, serve
from sitl.plant.plant import GRAVITY
from sitl.plant.variant import load_variant

NOMINAL = load_variant("nominal")


def frame(count: int, steer: int = 1500, throttle: int = 1500) -> ServoFrame:
    return ServoFrame(1200, count, (steer, 0, throttle) + (0,) * 13)


def datagram(count: int, steer: int = 1500, throttle: int = 1500, channels: int = 16) -> bytes:
    pwm = [steer, 0, throttle] + [0] * (channels - 3)
    return struct.pack(f"<HHI{channels}H", {16: 18458, 32: 29569}[channels], 1200, count, *pwm)


@pytest.mark.parametrize("channels", [16, 32])
def test_reads_both_layouts(channels: int) -> None:
    got = parse_request(datagram(7, 1400, 1600, channels))
    assert got is not None and (got.rate_hz, got.count, got.pwm[:3]) == (1200, 7, (1400, 0, 1600))
    assert len(got.pwm) == channels


@pytest.mark.parametrize("junk", [b"", b"\x1a", datagram(1)[:-1], datagram(1) + b"x", b"\0" * 40])
def test_refuses_anything_else(junk: bytes) -> None:
    assert parse_request(junk) is None


def test_the_reply_is_a_line_that_the_firmware_parses() -> None:
    reply = Physics(NOMINAL).answer(frame(0)).decode()
    assert reply.endswith("}\n") and reply.count("\n") == 1
    assert " " not in reply, "ArduPilot finds a value two characters behind its key"
    for key in (
        '"timestamp":',
        '"imu":{"gyro":[',
        '"accel_body":[',
        '"position":[',
        '"attitude":[',
        '"velocity":[',
    ):
        assert key in reply
    assert re.search(r'"velocity":\[-?\d+\.\d+,-?\d+\.\d+,-?\d+\.\d+\]', reply)


def test_steps_once_per_frame_and_repeats_the_reply_to_a_repeated_frame() -> None:
    physics = Physics(NOMINAL, rate_hz=1000.0)
    first = physics.answer(frame(0))
    second = physics.answer(frame(1))
    assert json.loads(first)["timestamp"] == pytest.approx(0.001)
    assert json.loads(second)["timestamp"] == pytest.approx(0.002)
    assert physics.answer(frame(1)) == second
    assert json.loads(physics.answer(frame(2)))["timestamp"] == pytest.approx(0.003)


def test_a_smaller_frame_count_starts_afresh() -> None:
    physics = Physics(NOMINAL)
    first = physics.answer(frame(0))
    for count in range(1, 3000):
        physics.answer(frame(count, 1500, 1700))
    assert physics.plant.state.vx > 0.5
    assert physics.answer(frame(0)) == first


def test_replies_are_consistent_and_unfiltered() -> None:
    """Yaw from the body rates by integration, at rest the raw noise of a sample, gravity up."""
    physics = Physics(NOMINAL)
    still = [json.loads(physics.answer(frame(count))) for count in range(1200)]
    gyro = np.array([line["imu"]["gyro"] for line in still])
    assert np.std(gyro[:, 2]) == pytest.approx(0.010, rel=0.1)
    assert np.mean([line["imu"]["accel_body"][2] for line in still]) == pytest.approx(-GRAVITY, abs=0.06)
    yaw = 0.0
    for k in range(1200, 3600):
        line = json.loads(physics.answer(frame(k, 1500 + round(150 * sin(k / 450)), 1700)))
        roll = line["attitude"][0]
        yaw += (line["imu"]["gyro"][2] - NOMINAL.gyro_bias[2]) / np.cos(roll) / 1200
    assert yaw == pytest.approx(line["attitude"][2], abs=0.02)
    assert abs(yaw) > 0.15


def test_writes_the_truth() -> None:
    sink = StringIO()
    physics = Physics(NOMINAL, truth=sink)
    for count in range(1200):
        physics.answer(frame(count, 1500, 1700))
    rows = np.loadtxt(StringIO(sink.getvalue()), delimiter=",")
    assert rows.shape == (50, 8)
    assert np.diff(rows[:, 0]) == pytest.approx(np.full(49, 0.02), abs=1e-3)
    assert rows[-1, 5] > 0.4


def test_answers_over_udp_on_loopback_and_ignores_junk() -> None:
    server = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    server.bind((LOOPBACK, 0))
    threading.Thread(target=serve, args=(Physics(NOMINAL), server), daemon=True).start()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as firmware:
        firmware.settimeout(5.0)
        firmware.sendto(b"not a servo frame", server.getsockname())
        firmware.sendto(datagram(0), server.getsockname())
        assert json.loads(firmware.recv(1000))["timestamp"] == pytest.approx(1 / 1200, abs=1e-6)


@pytest.mark.parametrize(
    ("argv", "said"),
    [
        (["--variant", "icy"], "no variant icy"),
        (["--rate", "10"], "must lie in 100..4000 Hz"),
        (["--steering-channel", "0"], "--steering-channel 0 must lie in 1..16"),
    ],
)
def test_wrong_options_are_explained(argv: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        main(argv)
    assert stop.value.code == 2
    assert said in capsys.readouterr().err
