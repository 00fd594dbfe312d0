"""Requests to a vehicle, repeated until their answer comes: commands and single messages."""

from __future__ import annotations

from collections.abc import Iterator

from rover_sweep.errors import LinkError
from rover_sweep.vehicle.link.connection import Connection
from rover_sweep.vehicle.link.link_quality import LONGEST, BadLink
from rover_sweep.vehicle.link.mavlink import Message, constant, kind, message_id, result_name

_IN_PROGRESS = 5  # MAV_RESULT_IN_PROGRESS
_NEVER = (2, 3, 4)  # MAV_RESULT: DENIED, UNSUPPORTED, FAILED (ArduPilot, for a message that it does not have)
_TRIES, _TIMEOUT = 3, 2.0  # of a request, s


class Refused(LinkError):
    """The vehicle answered, and refuses the command."""


class Requests(Connection):
    """A connection with requests and answers. Times are s of our clock (`line`)."""

    def attempts(self, timeout: float | None, tries: int | None) -> Iterator[float]:
        """The time to wait for each attempt [s], from the measured link; given values are used as they are.

        Before the first answer the link may be slow: the last wait is long enough for that.
        """
        attempt, began = 0, self.line.monotonic()
        while attempt < (tries or self.quality.tries(_TRIES)):
            attempt += 1
            wait = self.quality.wait(_TIMEOUT) if timeout is None else timeout
            last = attempt >= (tries or _TRIES) and timeout is None and self.quality.latency is None
            yield max(wait, LONGEST - (self.line.monotonic() - began)) if last else wait

    def command(
        self, name: str, *params: float, timeout: float | None = None, tries: int | None = None
    ) -> int:
        """Send COMMAND_LONG `name` (MAV_CMD_...) and return its MAV_RESULT (0 accepted).

        Repeated while no answer comes: as often as the link requires, or `tries` times with `timeout` s each.
        LinkError when no answer comes.
        """
        number, began = constant(name), self.line.monotonic()
        self.take_received()  # it may include a late acknowledgement of the previous command
        attempt = 0
        for attempt, wait in enumerate(self.attempts(timeout, tries)):
            sent = self.line.monotonic()
            self._send_command(number, params, attempt)
            answer = self._acknowledgement(number, wait)
            if answer is not None:
                self._absorb(number, attempt, sent)
                return int(answer.result)
        seconds = self.line.monotonic() - began
        asked = f"the vehicle did not answer {name} in {attempt + 1} tries and {seconds:.0f} s"
        raise self.no_answer(asked, "is the link too slow?")

    def _acknowledgement(self, number: int, wait: float) -> Message | None:
        return self.wait_for("COMMAND_ACK", wait, lambda m: m.command == number and m.result != _IN_PROGRESS)

    def _absorb(self, number: int, repeated: int, sent: float) -> None:
        """Take the other acknowledgements of a repeated command, so that the next command does not."""
        until = sent + self.quality.wait(0.0)
        for _ in range(repeated):
            left = until - self.line.monotonic()
            if left <= 0 or self._acknowledgement(number, left) is None:
                return

    def no_answer(self, what: str, otherwise: str) -> LinkError:
        """The error for a request without an answer: it names the link's measured fault, else `otherwise`."""
        fault = self.quality.words
        return BadLink(f"{what}: {fault}") if fault else LinkError(f"{what}; {otherwise}")

    def _send_command(self, number: int, params: tuple[float, ...], confirmation: int = 0) -> None:
        self.asked(("COMMAND_ACK", number))
        values = {f"param{i}": params[i - 1] if i <= len(params) else 0.0 for i in range(1, 8)}
        self.to_vehicle("COMMAND_LONG", command=number, confirmation=confirmation, **values)

    def require(self, what: str, name: str, *params: float, tries: int = 3) -> None:
        """Send a command that must be accepted; Refused, with the vehicle's status texts, if it is not."""
        before = len(self.texts)
        result = self.command(name, *params, tries=tries)
        if result == 0:
            return
        self.wait_for("STATUSTEXT", 0.3)
        reasons = "; ".join(text.text for text in list(self.texts)[before:][-3:])
        raise Refused(
            f"the vehicle refuses to {what} ({result_name(result)})" + (f": {reasons}" if reasons else "")
        )

    def request_message(
        self, name: str, timeout: float | None = None, tries: int | None = None
    ) -> Message | None:
        """Request one message by name and wait for it. None if it does not come, or if the vehicle says that
        it does not have it. Repeated as `command` is."""
        asked = constant("MAV_CMD_REQUEST_MESSAGE")
        for wait in self.attempts(timeout, tries):
            self._request(name)
            answer = self.wait_for(
                (name, "COMMAND_ACK"),
                wait,
                lambda m: kind(m) == name or (m.command == asked and m.result in _NEVER),
            )
            if answer is not None:
                if self.quality.latency is None:
                    self.take_received()  # the acknowledgement measures the latency
                return answer if kind(answer) == name else None
        return None

    def _request(self, name: str) -> None:
        self._send_command(constant("MAV_CMD_REQUEST_MESSAGE"), (message_id(name),))
