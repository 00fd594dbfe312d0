"""A scripted vehicle on a TCP port, for tests: obeys just enough of ArduPilot's rules, and can misbehave.

Its clock runs 20 ms a turn, much faster than real time. It has no dynamics: `sitl` has the rover.
"""

from __future__ import annotations

import socket
import struct
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as m

from firmware_params.applet_parameters import PARAMETERS, applet_source, applet_version
from rover_sweep.vehicle.link.link import crc32

SWITCH, THROTTLE, STEERING = 6, 3, 1
_FTP, _CRC32 = struct.Struct("<HBBBBBxI"), 14  # MAVLink FTP: head of a payload, opcode
_HURRIED = 5  # times longer holds an override on a clock that runs ahead of the one who sends it
_COURSE = (1, 2, 3, 4, 5, 6, 7, 8, 9, 0)  # states that a run goes through, 1 s each


def default_parameters() -> dict[str, float]:
    values = {p.name: float(p.default) for p in PARAMETERS}
    values |= {"SCR_ENABLE": 1.0, "SCHED_LOOP_RATE": 100.0, "RC6_OPTION": 300.0, "RC_OVERRIDE_TIME": 3.0}
    values |= {"FS_THR_ENABLE": 1.0, "RC1_DZ": 30.0, "RC3_DZ": 30.0, "SWP_VER": applet_version()}
    values |= {f"RC{n}_OPTION": 0.0 for n in range(1, 17) if n != SWITCH}
    for n in range(1, 5):
        values |= {f"SERVO{n}_FUNCTION": 0.0, f"SERVO{n}_TRIM": 1500.0, f"SERVO{n}_REVERSED": 0.0}
        values |= {f"SERVO{n}_MIN": 1100.0, f"SERVO{n}_MAX": 1900.0}
    values |= {"INS_ACCEL_FILTER": 10.0, "LOG_BITMASK": 65535.0}
    values |= {"SERVO1_FUNCTION": 26.0, "RC1_TRIM": 1500.0, "RC3_TRIM": 1500.0, "INS_GYRO_FILTER": 4.0}
    return values | {"RCMAP_ROLL": 1.0, "RCMAP_THROTTLE": 3.0}


@dataclass
class FakeVehicle:
    """Set what it is and how it misbehaves before `with`; look at what it saw afterwards."""

    vehicle_type: int = m.MAV_TYPE_GROUND_ROVER
    autopilot: int = m.MAV_AUTOPILOT_ARDUPILOTMEGA
    version: tuple[int, int, int] = (4, 6, 3)
    parameters: dict[str, float] = field(default_factory=default_parameters)
    fixed: frozenset[str] = frozenset()  # parameters that ignore PARAM_SET
    drop: Callable[[Any], bool] = lambda message: False  # replies that are lost
    applet: str = field(default_factory=applet_source)  # the text of its file
    sticks: dict[int, int] = field(default_factory=dict)  # of the radio, where they are not at rest [us]
    log: bytes = b""
    refuse_arming: str = ""
    stop_text: str = ""  # the applet stops in state 6 with this reason
    prefix: bytes = b""  # bytes sent before anything else
    silent: bool = False
    armed: bool = False
    received: list[Any] = field(default_factory=list)
    armed_ever: bool = False
    now: float = 0.0

    def __enter__(self) -> FakeVehicle:
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._end = threading.Event()
        self._mav = m.MAVLink(None, srcSystem=1, srcComponent=1)
        self._rc: dict[int, tuple[int, float]] = {}
        self._state, self._state_since, self._ready = 0, 0.0, True
        self._hang_up, self._whole = False, 0
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._end.set()
        self._thread.join(5)
        self._listener.close()

    @property
    def url(self) -> str:
        return f"tcp:127.0.0.1:{self._listener.getsockname()[1]}"

    def rc(self, channel: int) -> int:
        """What the vehicle acts on: the override while it lasts, else a radio at rest (switch low)."""
        value, since = self._rc.get(channel, (0, -9.0))
        rest = self.sticks.get(channel, 1000 if channel == SWITCH else 1500)
        lapse = _HURRIED * self.parameters["RC_OVERRIDE_TIME"]
        return value if value and self.now - since < lapse else rest

    def of_kind(self, name: str) -> list[Any]:
        return [message for message in self.received if message.get_type() == name]

    def hang_up(self) -> None:
        """Close the connection, as a reboot does."""
        self._hang_up = True

    # ---- its thread

    def _serve(self) -> None:
        self._listener.settimeout(0.01)
        while not self._end.is_set():
            try:
                self._socket, _ = self._listener.accept()
            except TimeoutError:
                continue
            with self._socket:
                self._connected()

    def _connected(self) -> None:
        self._socket.settimeout(0.001)
        parser = m.MAVLink(None)
        parser.robust_parsing = True
        self._hang_up = False
        try:
            self._socket.sendall(self.prefix)
            while not self._end.is_set() and not self._hang_up:
                try:
                    data = self._socket.recv(4096)
                    if not data:
                        return
                    for message in parser.parse_buffer(data) or []:
                        self.received.append(message)
                        self._answer(message)
                except TimeoutError:
                    pass
                self._turn()
        except OSError:
            return

    def _send(self, message: Any) -> None:
        if self.silent or self.drop(message):
            return
        self._socket.sendall(message.pack(self._mav))
        self._mav.seq = (self._mav.seq + 1) % 256

    def _turn(self) -> None:
        before, self.now = self.now, self.now + 0.02
        ms = int(self.now * 1000)
        if int(before) != int(self.now):
            self._heartbeat()
        self._send(m.MAVLink_attitude_message(ms, 0, 0, 0, 0, 0, 0.25))
        moves = self.armed and self.rc(THROTTLE) > 1500
        self._send(m.MAVLink_local_position_ned_message(ms, 0, 0, 0, 2.0 if moves else 0.0, 0, 0))
        pwm = [self.rc(n) if self.armed else 1500 for n in range(1, 9)]
        self._send(m.MAVLink_servo_output_raw_message(ms * 1000, 0, *pwm))
        self._send(m.MAVLink_raw_imu_message(ms * 1000, 0, 100, 0, 0, 0, 0, 0, 0, 0))
        self._applet()
        if int(before * 5) != int(self.now * 5):
            self._report(ms)

    def _report(self, ms: int) -> None:
        floats = {"SWP_ST": self._state, "SWP_RUN": self.parameters["SWP_RUN"], "SWP_DONE": self._whole}
        for name, value in floats.items():
            self._send(m.MAVLink_named_value_float_message(ms, name.encode(), value))

    def _heartbeat(self) -> None:
        mode = m.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | (m.MAV_MODE_FLAG_SAFETY_ARMED if self.armed else 0)
        self._send(m.MAVLink_heartbeat_message(self.vehicle_type, self.autopilot, mode, 0, 4, 3))

    def _applet(self) -> None:
        high = self.rc(SWITCH) > 1800
        self._ready = self._ready or not high
        if self._state == 0:
            if high and self._ready and self.armed:
                self._ready = False
                self.parameters["SWP_RUN"] += 1
                self._enter(1)
            return
        if self._state == 10:
            if not high:
                self._enter(0)
            return
        if self._state == 6 and self.stop_text:
            self._stop(self.stop_text)
        elif not high or not self.armed:
            self._stop("switch low" if not high else "disarmed")
        elif self.now - self._state_since > 1.0:
            following = _COURSE[_COURSE.index(self._state) + 1]
            if following == 0:
                self._text(f"SWP: run {self.parameters['SWP_RUN']:.0f} done")
                self._whole = int(self.parameters["SWP_RUN"])
            self._enter(following)

    def _stop(self, reason: str) -> None:
        self._text(f"SWP: run {self.parameters['SWP_RUN']:.0f} stopped: {reason}")
        self._enter(10)

    def _enter(self, state: int) -> None:
        self._state, self._state_since = state, self.now
        self._send(m.MAVLink_named_value_float_message(int(self.now * 1000), b"SWP_ST", state))

    def _text(self, text: str) -> None:
        for number, start in enumerate(range(0, len(text), 50)):
            identity = 7 if len(text) > 50 else 0
            part = text[start : start + 50].encode()
            self._send(m.MAVLink_statustext_message(6, part, identity, number))

    def _answer(self, message: Any) -> None:
        handler = getattr(self, f"_on_{message.get_type().lower()}", None)
        if handler is not None:
            handler(message)

    def _on_param_request_read(self, message: Any) -> None:
        if message.param_id in self.parameters:
            self._send_parameter(message.param_id)

    def _on_param_set(self, message: Any) -> None:
        if message.param_id in self.parameters:
            if message.param_id not in self.fixed:
                self.parameters[message.param_id] = message.param_value
            if message.param_id == "SWP_LAPSE":
                self._watch(message.param_value)
            self._send_parameter(message.param_id)

    def _watch(self, lapse: float) -> None:
        """As the applet: the override time of a run, and afterwards that of before."""
        if lapse:
            self.parameters["SWP_BACK"] = self.parameters["RC_OVERRIDE_TIME"]
        self.parameters["RC_OVERRIDE_TIME"] = lapse or self.parameters["SWP_BACK"]

    def _on_param_request_list(self, _: Any) -> None:
        for name in self.parameters:
            self._send_parameter(name)

    def _send_parameter(self, name: str) -> None:
        index = list(self.parameters).index(name)
        value, count = self.parameters[name], len(self.parameters)
        self._send(m.MAVLink_param_value_message(name.encode(), value, 9, count, index))

    def _on_rc_channels_override(self, message: Any) -> None:
        for n in range(1, 9):
            value = getattr(message, f"chan{n}_raw")
            if value != 0xFFFF:
                self._rc[n] = (value, self.now)

    def _on_file_transfer_protocol(self, message: Any) -> None:
        """Knows the checksum of its applet, and no other file."""
        sequence, _, opcode, size, *_ = _FTP.unpack_from(bytes(message.payload))
        path = bytes(message.payload[_FTP.size : _FTP.size + size]).rstrip(b"\0").decode()
        there = opcode == _CRC32 and path == "scripts/rover_sweep.lua"
        data = crc32(self.applet.encode()).to_bytes(4, "little") if there else bytes([2])
        head = _FTP.pack(sequence + 1, 0, 128 if there else 129, len(data), opcode, 0, 0)
        payload = list((head + data).ljust(251, b"\0"))
        self._send(m.MAVLink_file_transfer_protocol_message(0, 255, 0, payload))

    def _on_command_long(self, message: Any) -> None:
        result = self._command(message)
        self._send(m.MAVLink_command_ack_message(message.command, result))

    def _command(self, message: Any) -> int:
        if message.command == m.MAV_CMD_REQUEST_MESSAGE:
            self._requested(int(message.param1))
        elif message.command == m.MAV_CMD_COMPONENT_ARM_DISARM:
            return self._arm(message.param1 > 0.5)
        elif message.command == m.MAV_CMD_SET_MESSAGE_INTERVAL:
            fastest = int(1e6 / self.parameters["SCHED_LOOP_RATE"] / 800)
            return m.MAV_RESULT_DENIED if 0 < message.param2 < fastest * 1000 else m.MAV_RESULT_ACCEPTED
        elif message.command == m.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN:
            self.now, self._rc = 0.0, {}
            if "STAT_BOOTCNT" in self.parameters:
                self.parameters["STAT_BOOTCNT"] += 1
        return m.MAV_RESULT_ACCEPTED

    def _requested(self, number: int) -> None:
        if number == m.MAVLINK_MSG_ID_AUTOPILOT_VERSION:
            major, minor, patch = self.version
            packed = major << 24 | minor << 16 | patch << 8 | 255
            self._send(
                m.MAVLink_autopilot_version_message(
                    0, packed, 0, 0, 0, list(b"3fc7011a"), [0] * 8, [0] * 8, 0, 0, 42
                )
            )
        elif number == m.MAVLINK_MSG_ID_RC_CHANNELS:
            pwm = [self.rc(n) for n in range(1, 9)] + [0] * 10
            self._send(m.MAVLink_rc_channels_message(int(self.now * 1000), 8, *pwm, 255))
        elif number == m.MAVLINK_MSG_ID_SYSTEM_TIME:
            self._send(m.MAVLink_system_time_message(0, int(self.now * 1000)))

    def _arm(self, arm: bool) -> int:
        if arm and self.refuse_arming:
            self._text(self.refuse_arming)
            return m.MAV_RESULT_FAILED
        self.armed = arm
        self.armed_ever |= arm
        self._heartbeat()
        return m.MAV_RESULT_ACCEPTED

    def _on_log_request_list(self, _: Any) -> None:
        if self.log:
            self._send(m.MAVLink_log_entry_message(1, 1, 1, 0, len(self.log)))
        else:
            self._send(m.MAVLink_log_entry_message(0, 0, 0, 0, 0))

    def _on_log_request_data(self, message: Any) -> None:
        for offset in range(message.ofs, min(message.ofs + message.count, len(self.log)), 90):
            block = self.log[offset : min(offset + 90, message.ofs + message.count)]
            padded = list(block) + [0] * (90 - len(block))
            self._send(m.MAVLink_log_data_message(1, offset, len(block), padded))


def wait_until(condition: Callable[[], bool], seconds: float = 5.0) -> bool:
    """Whether the condition came true in time."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if condition():
            return True
        time.sleep(0.005)
    return condition()
