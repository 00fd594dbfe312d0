"""Runs a program that must not outlive its caller: `python -m sitl.guard PROGRAM [ARGUMENT ...]`.

The program is stopped when the guard's standard input closes, which the operating system sees to even when
the process at the other end of the pipe is killed. (ArduRover looks for its parent only while its physics
answers, and not at all before a first client connects.)
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Sequence
from types import FrameType

from rover_sweep.system import end_own_group

GRACE = 3.0
"""Seconds between asking the program to end and killing it."""


def main(command: Sequence[str]) -> int:
    """Run `command` to its end, or until standard input closes; returns its exit code."""
    program = subprocess.Popen(command, stdin=subprocess.DEVNULL)

    def stop(_signal: int = 0, _frame: FrameType | None = None) -> None:
        program.terminate()
        killer = threading.Timer(GRACE, program.kill)
        killer.daemon = True
        killer.start()

    def watch() -> None:
        while os.read(sys.stdin.fileno(), 4096):
            pass
        stop()

    signal.signal(signal.SIGTERM, stop)
    signal.signal(signal.SIGINT, stop)
    threading.Thread(target=watch, name="watch standard input", daemon=True).start()
    code = program.wait()
    end_own_group()  # the program's remaining children
    return code


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
