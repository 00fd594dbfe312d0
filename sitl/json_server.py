"""JSON physics server: the plant behind the real firmware (`ardurover --model JSON:127.0.0.1`).

Protocol as in ArduPilot 4.6.3 libraries/SITL/SIM_JSON.cpp: the firmware sends a binary datagram with the
servo PWM and waits for one line of compact JSON (its parser wants the value right after the colon); the
two run in lock-step. Sensors are unfiltered, the firmware filters. The velocity and attitude are the
truth at the IMU: the firmware runs its own estimator on the sensors.
"""

from __future__ import annotations

import argparse
import json
import socket
import struct
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

from sitl.plant.plant import Plant
from sitl.plant.sensors import Sensors
from sitl.plant.variant import PlantParameters, load_variant
from sitl.plant.wheel_imu import WheelImu

BASE_PORT = 9002
LOOPBACK = "127.0.0.1"
TRUTH_HEADER = "t,pwm,delta,r,Vy,Vx,phi,p\n"
_TRUTH_INTERVAL = 0.02
_LAYOUTS = {18458: struct.Struct("<HHI16H"), 29569: struct.Struct("<HHI32H")}


@dataclass(frozen=True)
class ServoFrame:
    """A request: the rate [Hz] the firmware wants, its frame number, PWM [us] of 16 or 32 channels."""

    rate_hz: int
    count: int
    pwm: tuple[int, ...]


def parse_request(datagram: bytes) -> ServoFrame | None:
    """The servo frame in a datagram, None for other datagrams."""
    layout = _LAYOUTS.get(int.from_bytes(datagram[:2], "little"))
    if layout is None or len(datagram) != layout.size:
        return None
    _, rate, count, *pwm = layout.unpack(datagram)
    return ServoFrame(rate, count, tuple(pwm))


class Physics:
    """Plant and sensors stepped by servo frames.

    A repeated frame count (the firmware resends when it hears nothing) gets the last reply again without
    a step; a smaller one means that the firmware started afresh, and so does the plant.
    """

    def __init__(
        self,
        parameters: PlantParameters,
        seed: int = 1,
        rate_hz: float = 1200.0,
        steering_channel: int = 1,
        throttle_channel: int = 3,
        truth: TextIO | None = None,
        wheel: WheelImu | None = None,
    ) -> None:
        self.parameters = parameters
        self.seed = seed
        self.rate_hz = rate_hz
        self._steering, self._throttle = steering_channel - 1, throttle_channel - 1
        self._truth = truth
        self._wheel = wheel
        self._reset()

    def _reset(self) -> None:
        self.plant = Plant(self.parameters, self.seed)
        self.sensors = Sensors(self.parameters, self.seed, self.rate_hz, 0.0, 0.0)
        self._count = -1
        self._reply = b""
        self._next_truth = 0.0

    def answer(self, frame: ServoFrame) -> bytes:
        """The reply to a frame, stepping the plant by 1/rate_hz when the frame is new."""
        if frame.count < self._count:
            self._reset()
        if frame.count != self._count:
            self._count = frame.count
            steering, throttle = frame.pwm[self._steering], frame.pwm[self._throttle]
            self.plant.step(steering, throttle, 1.0 / self.rate_hz)
            self.sensors.update(self.plant.state)
            self._reply = reply_line(self.plant.state.t, self.sensors)
            self._write_truth(steering)
            if self._wheel is not None:
                self._wheel.sample(self.plant.state.t, self.plant.state)
        return self._reply

    def _write_truth(self, pwm: int) -> None:
        state = self.plant.state
        if self._truth is None or state.t < self._next_truth:
            return
        self._next_truth = state.t + _TRUTH_INTERVAL - 1e-6
        self._truth.write(
            f"{state.t:.5f},{pwm},{state.delta:.6f},{state.r:.6f},{state.vy:.6f},"
            f"{state.vx:.5f},{state.phi:.6f},{state.p:.6f}\n"
        )


def reply_line(t: float, sensors: Sensors) -> bytes:
    """One line of compact JSON: FRD body rates and specific force, NED position and velocity, attitude."""
    gx, gy, gz = sensors.gyro_raw
    ax, ay, az = sensors.accel_raw
    north, east, down = sensors.true_position
    roll, pitch, yaw = sensors.true_attitude
    vn, ve, vd = sensors.true_velocity
    return (
        f'{{"timestamp":{t:.6f},"imu":{{"gyro":[{gx:.7f},{gy:.7f},{gz:.7f}],'
        f'"accel_body":[{ax:.6f},{ay:.6f},{az:.6f}]}},"position":[{north:.5f},{east:.5f},{down:.5f}],'
        f'"attitude":[{roll:.7f},{pitch:.7f},{yaw:.7f}],"velocity":[{vn:.6f},{ve:.6f},{vd:.6f}]}}\n'
    ).encode("ascii")


def serve(physics: Physics, link: socket.socket) -> None:
    """Answer servo frames on a bound UDP socket for ever; other datagrams are ignored and reported once."""
    reported = False
    while True:
        datagram, sender = link.recvfrom(256)
        frame = parse_request(datagram)
        if frame is not None:
            link.sendto(physics.answer(frame), sender)
        elif not reported:
            print(f"ignored {len(datagram)} bytes that are not a servo frame of ArduPilot", file=sys.stderr)
            reported = True


def _arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m sitl.json_server", description=__doc__.splitlines()[0])
    parser.add_argument("--variant", default="nominal", help="variant name or TOML file")
    parser.add_argument(
        "--instance", type=int, default=0, help="ArduPilot's instance: UDP port 9002 + 10 per instance"
    )
    parser.add_argument("--port", type=int, help="UDP port instead of the instance's; 0 picks a free one")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--rate", type=float, default=1200.0, help="physics steps per second of vehicle time")
    parser.add_argument("--steering-channel", type=int, default=1)
    parser.add_argument("--throttle-channel", type=int, default=3)
    parser.add_argument(
        "--truth", type=Path, help=f"write the true motion to this CSV file ({TRUTH_HEADER.strip()})"
    )
    parser.add_argument("--wheel", type=Path, help="an IMU on the front wheel writes this CSV file")
    arguments = parser.parse_args(argv)
    if not 100 <= arguments.rate <= 4000:
        parser.error(f"--rate {arguments.rate} must lie in 100..4000 Hz")
    for option in ("steering_channel", "throttle_channel"):
        if not 1 <= getattr(arguments, option) <= 16:
            parser.error(f"--{option.replace('_', '-')} {getattr(arguments, option)} must lie in 1..16")
    try:
        arguments.parameters = load_variant(arguments.variant)
    except ValueError as error:
        parser.error(str(error))
    return arguments


def main(argv: Sequence[str] | None = None) -> None:
    """Serve until interrupted; prints one line of JSON with the port when ready."""
    arguments = _arguments(argv)
    port = BASE_PORT + 10 * arguments.instance if arguments.port is None else arguments.port
    truth = arguments.truth.open("w", buffering=1, encoding="ascii") if arguments.truth else None
    if truth:
        truth.write(TRUTH_HEADER)
    physics = Physics(
        arguments.parameters,
        arguments.seed,
        arguments.rate,
        arguments.steering_channel,
        arguments.throttle_channel,
        truth,
        WheelImu(arguments.wheel, arguments.seed) if arguments.wheel else None,
    )
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
        try:
            link.bind((LOOPBACK, port))
        except OSError as error:
            sys.exit(f"cannot use UDP port {port} on {LOOPBACK} ({error.strerror}): give another --instance")
        print(json.dumps({"udp": link.getsockname()[1], "variant": arguments.variant}), flush=True)
        try:
            serve(physics, link)
        except KeyboardInterrupt:
            sys.exit(130)


if __name__ == "__main__":
    main()
