"""Drops keys typed before a question, so that they do not answer it."""

from __future__ import annotations

import contextlib
import sys


def forget_typed() -> None:
    """Drop pending input of a terminal: a key pressed earlier must not move a vehicle. A pipe is not read."""
    with contextlib.suppress(OSError, ValueError, AttributeError):
        if sys.stdin.isatty():
            _flush()


def _flush() -> None:
    try:
        import termios
    except ImportError:  # Windows
        import msvcrt

        while msvcrt.kbhit():  # type: ignore[attr-defined,unused-ignore]
            msvcrt.getwch()  # type: ignore[attr-defined,unused-ignore]
        return
    with contextlib.suppress(termios.error):
        termios.tcflush(sys.stdin.fileno(), termios.TCIFLUSH)
