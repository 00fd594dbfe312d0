"""A program in a terminal of its own, and what stands on its screen: as much of a VT100 as Textual uses."""

from __future__ import annotations

import fcntl
import os
import pty
import re
import struct
import subprocess
import termios
import threading
import time
from collections.abc import Mapping, Sequence

_PART = re.compile(
    r"\x1b\[(?P<at>\d+;\d+)H"  # the cursor's new place: row;column
    r"|\x1b\[[?>=]?[0-9;]*[ $]?[a-zA-Z]|\x1b[()][A-Z0-9]|\x1b[=>78]"  # styles, modes
    r"|\x1b[P\]].*?(?:\x1b\\|\x07)"
    r"|(?P<text>[^\x1b\r\n]+)|[\r\n]",
    re.DOTALL,
)


class Terminal:
    """Starts `command`; size: (columns, rows). Killed at the end of the block, with nothing put in order."""

    def __init__(
        self, command: Sequence[str], environment: Mapping[str, str], size: tuple[int, int] = (80, 24)
    ) -> None:
        self.size = size
        self._master, slave = pty.openpty()
        fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", size[1], size[0], 0, 0))
        self.program = subprocess.Popen(
            command,
            stdin=slave,
            stdout=slave,
            stderr=slave,
            start_new_session=True,
            env={**os.environ, **environment, "TERM": "xterm-256color", "COLORTERM": "truecolor"},
        )
        os.close(slave)
        self._said = bytearray()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        while True:
            try:
                said = os.read(self._master, 65536)
            except OSError:  # the program has ended
                return
            if not said:
                return
            self._said += said

    @property
    def screen(self) -> str:
        """The rows."""
        columns, rows = self.size
        cells = [[" "] * columns for _ in range(rows)]
        row = column = 0
        for part in _PART.finditer(bytes(self._said[-200_000:]).decode(errors="replace")):
            if part["at"]:
                row, column = (int(n) - 1 for n in part["at"].split(";"))
            for character in part["text"] or "":
                if row < rows and column < columns:
                    cells[row][column] = character
                column += 1
        return "\n".join("".join(cell).rstrip() for cell in cells)

    def press(self, *keys: str) -> None:
        for key in keys:
            os.write(self._master, key.encode())

    def until(self, *words: str, seconds: float = 45.0) -> None:
        """Waits until all of them stand there."""
        end = time.monotonic() + seconds
        while not all(word in self.screen for word in words):
            assert time.monotonic() < end, f"{words} did not come within {seconds} s:\n{self.screen}"
            time.sleep(0.1)

    def __enter__(self) -> Terminal:
        return self

    def __exit__(self, *_: object) -> None:
        self.program.kill()
        self.program.wait()
        self._reader.join(5)
        os.close(self._master)
