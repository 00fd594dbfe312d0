"""One ground station's MAVLink 2 session with the embedded rover: what comes in, what goes out."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.rover import GCS_COMMAND, INFO, Rover
from sitl.autopilot.vehicle_parameters import MAV_PARAM_TYPE, Parameter
from sitl.autopilot.version import FIRMWARE
from sitl.ground.commands import Commands
from sitl.ground.file_transfer import FileTransfer
from sitl.ground.log_transfer import LogTransfer
from sitl.ground.message_intervals import StreamSchedule
from sitl.ground.messages import BUILDERS, STREAM_GROUPS, default_interval_ms
from sitl.ground.server import Peer

COMPONENT = 1
BY_NAME = 65535  # param_index of an answer that is not part of the list
PARAMETERS_PER_LOOP = 20
TIMESYNC_MS = 10_000
FTP_BUSY_MS = 1000
HEARTBEAT = mavlink.MAVLINK_MSG_ID_HEARTBEAT
OVERRIDE_FIELDS = [f"chan{n}_raw" for n in range(1, 17)]
LOG_KINDS = frozenset({"LOG_REQUEST_LIST", "LOG_REQUEST_DATA", "LOG_REQUEST_END", "LOG_ERASE"})


class GroundLink:
    """A session on one peer; `receive` and `send` are called once a main loop."""

    def __init__(
        self, rover: Rover, peer: Peer, logs: LogTransfer, files: FileTransfer, reboot: Callable[[], None]
    ) -> None:
        self.rover, self.peer, self.logs, self.files = rover, peer, logs, files
        self._mav = mavlink.MAVLink(
            None, srcSystem=int(rover.parameters["SYSID_THISMAV"]), srcComponent=COMPONENT
        )
        self._mav.robust_parsing = True

        def clock() -> int:
            return rover.now_ms

        def default_ms(message_id: int) -> int | None:
            return default_interval_ms(rover, message_id)

        self.streams = StreamSchedule(rover.loop_period_us, clock, default_ms)
        self.heartbeats = StreamSchedule(rover.loop_period_us, clock, default_ms)  # takes no bucket
        for message_id in STREAM_GROUPS:
            self.streams.set(message_id, default_ms(message_id) or 0)
        self.heartbeats.set(HEARTBEAT, 1000)
        self.commands = Commands(rover, self, reboot)
        self._parameters: deque[tuple[int, int, Parameter]] = deque()
        self._timesync_ms = self._text_number = 0
        self._ftp_ms = -FTP_BUSY_MS

    # ---- out

    def send_message(self, message: Any) -> None:
        """Queues one message for the peer."""
        data = message.pack(self._mav)
        self._mav.seq = (self._mav.seq + 1) % 256
        self.peer.queue(data, self.rover.now_us)

    def send(self) -> None:
        """The messages that are due, the next parameters of a list, the next packets of a log."""
        transferring = bool(self._parameters) or self.rover.now_ms - self._ftp_ms < FTP_BUSY_MS
        for message_id in (*self.heartbeats.due(), *self.streams.due(transferring)):
            message = BUILDERS[message_id](self.rover)
            if message is not None:
                self.send_message(message)
        for _ in range(min(PARAMETERS_PER_LOOP, len(self._parameters))):
            self.send_parameter(*self._parameters.popleft())
        if self.rover.now_ms - self._timesync_ms > TIMESYNC_MS:
            self._timesync_ms = self.rover.now_ms
            self.send_message(mavlink.MAVLink_timesync_message(0, self.rover.now_us * 1000))

    def schedule_of(self, message_id: int) -> StreamSchedule:
        """Where the interval of a message is kept."""
        return self.heartbeats if message_id == HEARTBEAT else self.streams

    def send_text(self, severity: int, text: str) -> None:
        """STATUSTEXT, in chunks of 50 where it is longer."""
        data = text.encode("ascii", "replace")[:254]
        chunks = [data[k : k + 50] for k in range(0, len(data), 50)] or [b""]
        self._text_number = self._text_number % 65535 + 1
        number = self._text_number if len(chunks) > 1 else 0
        for k, chunk in enumerate(chunks):
            self.send_message(mavlink.MAVLink_statustext_message(severity, chunk, number, k))

    def send_parameter(self, index: int, count: int, parameter: Parameter) -> None:
        name, kind = parameter.name.encode(), MAV_PARAM_TYPE[parameter.kind]
        self.send_message(mavlink.MAVLink_param_value_message(name, parameter.value, kind, count, index))

    def send_named_float(self, name: str, value: float) -> None:
        """NAMED_VALUE_FLOAT of a script; names have 10 letters at most."""
        label = name.encode("ascii", "replace")[:10]
        self.send_message(mavlink.MAVLink_named_value_float_message(self.rover.now_ms, label, value))

    def echo_parameter(self, parameter: Parameter) -> None:
        """The answer to a PARAM_SET, to every link."""
        self.send_parameter(BY_NAME, len(self.rover.parameters.listed()), parameter)

    # ---- in

    def receive(self, data: bytes) -> None:
        """Everything that has come in."""
        for message in self._mav.parse_buffer(data) or ():
            self._take(message)

    def _take(self, message: Any) -> None:
        kind = message.get_type()
        if getattr(message, "target_system", 0) not in (0, self._mav.srcSystem):
            return
        if kind in LOG_KINDS:
            self.logs.handle(kind, message, self.send_message)
            return
        handler: Callable[[Any], None] | None = getattr(self, f"_on_{kind.lower()}", None)
        if handler is not None:
            handler(message)

    def _from_pilot(self, message: Any) -> bool:
        """Whether it comes from the ground station that may drive (SYSID_MYGCS); notes that it was heard."""
        if message.get_srcSystem() != self.rover.parameters["SYSID_MYGCS"]:
            return False
        self.rover.gcs_seen_ms = self.rover.now_ms
        return True

    def _on_heartbeat(self, message: Any) -> None:
        self._from_pilot(message)

    def _on_rc_channels_override(self, message: Any) -> None:
        if self._from_pilot(message):
            self.rover.radio.override([getattr(message, f) for f in OVERRIDE_FIELDS], self.rover.now_ms)

    def _on_param_request_list(self, message: Any) -> None:
        self.send_text(INFO, FIRMWARE)
        listed = self.rover.parameters.listed()
        self._parameters = deque((k, len(listed), p) for k, p in enumerate(listed))

    def _on_param_request_read(self, message: Any) -> None:
        listed = self.rover.parameters.listed()
        index = message.param_index
        if index >= 0:
            if index < len(listed):
                self.send_parameter(index, len(listed), listed[index])
        elif (parameter := self.rover.parameters.find(message.param_id)) is not None:
            self.send_parameter(BY_NAME, len(listed), parameter)

    def _on_param_set(self, message: Any) -> None:
        self.rover.parameters.set(message.param_id, message.param_value)

    def _on_command_long(self, message: Any) -> None:
        self._command(message, [getattr(message, f"param{n}") for n in range(1, 8)])

    def _on_command_int(self, message: Any) -> None:
        first = [message.param1, message.param2, message.param3, message.param4]
        self._command(message, [*first, message.x, message.y, message.z])

    def _command(self, message: Any, numbers: list[float]) -> None:
        result = self.commands.run(message.command, numbers)
        sender = (message.get_srcSystem(), message.get_srcComponent())
        self.send_message(mavlink.MAVLink_command_ack_message(message.command, result, 0, 0, *sender))

    def _on_set_mode(self, message: Any) -> None:
        result = self.commands.set_mode(message.base_mode, message.custom_mode, GCS_COMMAND)
        sender = (message.get_srcSystem(), message.get_srcComponent())
        command = mavlink.MAVLINK_MSG_ID_SET_MODE
        self.send_message(mavlink.MAVLink_command_ack_message(command, result, 0, 0, *sender))

    def _on_timesync(self, message: Any) -> None:
        if message.tc1 == 0:
            self.send_message(mavlink.MAVLink_timesync_message(self.rover.now_us * 1000, message.ts1))

    def _on_ping(self, message: Any) -> None:
        if message.target_system == 0:
            sender = (message.get_srcSystem(), message.get_srcComponent())
            self.send_message(mavlink.MAVLink_ping_message(message.time_usec, message.seq, *sender))

    def _on_request_data_stream(self, message: Any) -> None:
        """REQUEST_DATA_STREAM: rates by groups, of which only 'all' is handled."""
        if message.req_stream_id != mavlink.MAV_DATA_STREAM_ALL:
            return
        rate = message.req_message_rate if message.start_stop else 0
        for message_id in STREAM_GROUPS:
            self.streams.set(message_id, int(1000 / rate) if rate else 0)

    def _on_file_transfer_protocol(self, message: Any) -> None:
        self._ftp_ms = self.rover.now_ms
        sender = (message.get_srcSystem(), message.get_srcComponent())
        for payload in self.files.handle(bytes(message.payload)):
            self.send_message(mavlink.MAVLink_file_transfer_protocol_message(0, *sender, list(payload)))
