"""Questions of `bench` at the terminal: before each movement, and for angles; the link stays alive."""

from __future__ import annotations

import os
import re
import select
import sys
from collections.abc import Callable
from math import nan, radians

from rover_sweep.bench.drive import Keep
from rover_sweep.bench.programme import Movement
from rover_sweep.cli.views.typed_ahead import forget_typed
from rover_sweep.errors import UsageError

LARGEST = 60.0  # deg
_YES = ("y", "yes")
_NUMBER = re.compile(r"\s*([+-]?\d+(?:[.,]\d*)?|[+-]?[.,]\d+)\s*(?:deg|°)?\s*([lr]?)\s*", re.IGNORECASE)


def parse_angle(text: str) -> float | None:
    """Angle in rad, left positive, from `12.5`, `-3`, `4,2 l` or `4.2r`; None for other text."""
    match = _NUMBER.fullmatch(text)
    if not match:
        return None
    degrees, side = float(match[1].replace(",", ".")), match[2].lower()
    if abs(degrees) > LARGEST or (side and match[1].strip()[0] in "+-"):
        return None
    return radians(-degrees if side == "r" else degrees)


class Terminal:
    """An `Operator` at a terminal. unasked: allow movements without asking (simulated rover)."""

    def __init__(self, say: Callable[[str], None], unasked: bool = False) -> None:
        self._say, self._unasked = say, unasked
        self._pending = b""

    def tell(self, text: str) -> None:
        self._say(text)

    def allow(self, movement: Movement, stops: str, keep: Keep) -> bool:
        """True if the user types yes; any other answer skips this movement."""
        self._say(f"\n{movement.name}: {movement.words}\n{stops}")
        if self._unasked:
            return True
        self._forget()
        self._say("wheels off the ground, hands and cables clear? yes to move, anything else to skip:")
        return self._line(keep).strip().lower() in _YES

    def angle(self, number: int, of: int, offset: float, keep: Keep) -> tuple[float, str]:
        """Ask until an angle is typed; (rad, text), (nan, "") for an empty line."""
        self._forget()
        self._say(f"{number}/{of}, {offset:+.0f} us: wheel angle [deg], l or r (empty: skip)")
        while True:
            typed = self._line(keep).strip()
            if not typed:
                return nan, ""
            angle = parse_angle(typed)
            if angle is not None:
                return angle, typed
            self._say(
                f"{typed!r} is not an angle; type up to {LARGEST:g} deg, as '12.5 l', '3 r' or '-4' (right)"
            )

    def _forget(self) -> None:
        """Drop what was typed before the question."""
        if sys.stdin.isatty():
            self._pending = b""
            forget_typed()

    def _line(self, keep: Keep) -> str:
        """A line of stdin; keeps the link alive meanwhile. UsageError at the end of input."""
        try:
            source = sys.stdin.fileno()
        except (OSError, ValueError, AttributeError):  # not a file, as in a program that calls this one
            text = sys.stdin.readline()
            if text:
                return text
            raise UsageError("no answer (end of input); the steering was released") from None
        while b"\n" not in self._pending:
            keep()
            if not select.select([source], [], [], 0.0)[0]:
                continue
            data = os.read(source, 4096)
            if not data:
                raise UsageError("no answer (end of input); the steering was released")
            self._pending += data
        line, _, self._pending = self._pending.partition(b"\n")
        return line.decode(errors="replace")
