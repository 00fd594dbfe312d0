"""Log list, download and erase over MAVLink, as AP_Logger_MAVLinkLogTransfer does it.

Refused while armed ("Disarm for log download", once). One link at a time. While a log is being sent nothing
is logged, so that what is sent is the file. Log ids count from 1.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.rover import ERROR, INFO, Rover

CHUNK = 90
PACKETS_PER_MS = 40  # as ArduPilot's SITL
Send = Callable[[Any], None]


class LogTransfer:
    """The vehicle's log transfer: one at a time. A link is identified by its `send`."""

    def __init__(self, rover: Rover) -> None:
        self.rover = rover
        self._warned = False
        self._send: Send | None = None
        self._id = 0
        self._data = b""
        self._offset = self._end = 0

    @property
    def busy(self) -> bool:
        return self._send is not None

    def handle(self, kind: str, message: Any, send: Send) -> None:
        """A LOG_REQUEST_LIST, LOG_REQUEST_DATA, LOG_REQUEST_END or LOG_ERASE from the link of `send`."""
        if self.rover.armed:
            if not self._warned:
                self.rover.text(ERROR, "Disarm for log download")
            self._warned = True
            return
        self._warned = False
        if kind == "LOG_REQUEST_END":
            self._finish()
        elif kind == "LOG_ERASE":
            self._finish()
            self.rover.log.erase()
        elif self.busy:
            if send != self._send:
                self.rover.text(INFO, "Log download in progress")
        elif kind == "LOG_REQUEST_LIST":
            self._list(message.start, message.end, send)
        elif kind == "LOG_REQUEST_DATA":
            self._start(message.id, message.ofs, message.count, send)

    def _list(self, first: int, last: int, send: Send) -> None:
        self.rover.log.flush()
        files = self.rover.log.files()
        if not files:
            send(mavlink.MAVLink_log_entry_message(0, 0, 0, 0, 0))
            return
        last = min(last, len(files))
        for number in range(max(first, 1), last + 1):
            status = files[number - 1].stat()
            entry = (number, len(files), last, int(status.st_mtime), status.st_size)
            send(mavlink.MAVLink_log_entry_message(*entry))

    def _start(self, number: int, offset: int, count: int, send: Send) -> None:
        log = self.rover.log
        files = log.files()
        if not 1 <= number <= len(files):
            self._finish()
            return
        log.flush()
        if number != self._id or files[number - 1].stat().st_size != len(self._data):
            self._id, self._data = number, files[number - 1].read_bytes()
        log.downloading = True
        self._send = send
        self._offset, self._end = offset, min(len(self._data), offset + count)

    def pump(self, loop_period_us: int) -> None:
        """Sends the packets of one main loop; call while the link accepts more."""
        for _ in range(max(1, PACKETS_PER_MS * loop_period_us // 1000)):
            if self._send is None or self.rover.armed:
                return
            part = self._data[self._offset : min(self._offset + CHUNK, self._end)]
            data = [*part, *bytes(CHUNK - len(part))]
            self._send(mavlink.MAVLink_log_data_message(self._id, self._offset, len(part), data))
            self._offset += len(part)
            if len(part) < CHUNK or self._offset >= self._end:
                self._end_of_request()

    def forget(self, send: Send) -> None:
        """Ends the transfer of a closed link."""
        if self._send == send:
            self._finish()

    def _finish(self) -> None:
        self._end_of_request()
        self._id, self._data = 0, b""

    def _end_of_request(self) -> None:
        """Logging goes on between two requests."""
        self._send = None
        self.rover.log.downloading = False
