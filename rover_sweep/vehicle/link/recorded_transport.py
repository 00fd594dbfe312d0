"""Connections recorded in both directions (see `conversation`)."""

from __future__ import annotations

import datetime
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from rover_sweep._version import __version__
from rover_sweep.errors import LinkError
from rover_sweep.vehicle.link.conversation import ConversationKind, ConversationWriter
from rover_sweep.vehicle.link.recorder import writing
from rover_sweep.vehicle.link.transport import Line, LiveLine, Transport


def conversation_in(folder: Path) -> Path:
    """A path for a new conversation in a session's folder; never an existing file."""
    path, number = folder / "session.conversation", 2
    while path.exists():
        path, number = folder / f"session-{number}.conversation", number + 1
    return path


class RecordedLine:
    """A line that records everything that goes over it, from its first connection to `close`.

    failure: why the recording ended early, else ''. Use as a context manager.
    """

    def __init__(self, path: Path, line: Line | None = None, about: Mapping[str, Any] | None = None) -> None:
        self._line = line or LiveLine()
        began = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
        with writing(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            self._writer = ConversationWriter(
                path, {"rover_sweep": __version__, "began": began, **(about or {})}
            )

    @property
    def failure(self) -> str:
        return self._writer.failure

    def open(self, url: str, timeout: float = 5.0) -> Transport:
        try:
            transport = self._line.open(url, timeout)
        except LinkError as error:
            self.note(ConversationKind.REFUSED, str(error).encode())
            raise
        self.note(ConversationKind.OPENED, url.encode())
        return RecordedTransport(transport, self)

    def monotonic(self) -> float:
        return self._line.monotonic()

    def since_boot(self) -> float:
        return self._line.since_boot()

    def wall(self) -> float:
        return self._line.wall()

    def sleep(self, seconds: float) -> None:
        self._line.sleep(seconds)

    def note(self, kind: ConversationKind, data: bytes = b"") -> None:
        """Write an entry of now."""
        self._writer.write(kind, round(self._line.monotonic() * 1e6), data)

    def close(self) -> None:
        self._writer.close()

    def __enter__(self) -> RecordedLine:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class RecordedTransport(Transport):
    """A connection that passes everything to its line for recording."""

    def __init__(self, transport: Transport, line: RecordedLine) -> None:
        self._transport, self._line = transport, line

    def receive(self, timeout: float) -> bytes:
        try:
            data = self._transport.receive(timeout)
        except (OSError, ValueError) as error:
            self._line.note(ConversationKind.ENDED, str(error).encode())
            raise
        if data:
            self._line.note(ConversationKind.RECEIVED, data)
        return data

    def send(self, data: bytes) -> None:
        try:
            self._transport.send(data)
        except OSError:
            self._line.note(ConversationKind.UNSENT, data)
            raise
        self._line.note(ConversationKind.SENT, data)

    def settle(self, system: int) -> None:
        self._transport.settle(system)

    def believe(self, authentic: Callable[[bytes], bool]) -> None:
        self._transport.believe(authentic)

    def remark(self) -> str:
        return self._transport.remark()

    def close(self) -> None:
        self._transport.close()
        self._line.note(ConversationKind.CLOSED)
