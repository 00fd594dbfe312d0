"""The content of a screen as rows of styled text, cut to a width and a height."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

from rich.text import Text
from textual import events
from textual.app import ComposeResult
from textual.containers import Vertical
from textual.screen import ModalScreen
from textual.widgets import Static

from firmware_params.applet_parameters import SWITCH_HIGH, SWITCH_LOW
from rover_sweep.data.braille import BARS
from rover_sweep.files.documents import printable_lines, same_length
from rover_sweep.manoeuvre.multisine import Multisine
from rover_sweep.manoeuvre.sweep import Doublet, Manoeuvre, Sweep
from rover_sweep.vehicle import identity as vehicle_modes

# Numbers as characters: bar, pointer between limits, short history, number or dash.


def bar(share: float, width: int) -> str:
    """`share` 0..1 of `width` cells; an empty bar for NaN."""
    full = round(min(1.0, max(0.0, share)) * width) if math.isfinite(share) else 0
    return "█" * full + "░" * (width - full)


def pointer(value: float, low: float, high: float, width: int) -> str:
    """Position of `value` between two limits, with the middle marked; an arrow at the edge if outside."""
    cells = list("[" + "·" * (width - 2) + "]")
    cells[width // 2] = "|"
    if math.isfinite(value) and high > low:
        share = (value - low) / (high - low)
        if share < 0:
            cells[0] = "◀"
        elif share > 1:
            cells[-1] = "▶"
        else:
            cells[1 + round(share * (width - 3))] = "█"
    return "".join(cells)


def column_chart(values: Sequence[float], low: float, high: float, width: int, rows: int = 1) -> list[str]:
    """The last `width` values between two limits as columns, the newest at the right; blank for NaN.

    Returns `rows` rows, the uppermost first.
    """
    heights = [_height(value, low, high, rows) for value in values[-width:]]
    return [
        "".join(BARS[min(8, max(0, height - 8 * row))] for height in heights).rjust(width)
        for row in reversed(range(rows))
    ]


def _height(value: float, low: float, high: float, rows: int) -> int:
    """Height of a column in eighths of a row: at least one, 0 for NaN."""
    if not math.isfinite(value):
        return 0
    share = min(1.0, max(0.0, (value - low) / (high - low)))
    return max(1, round(share * 8 * rows))


def fixed_width(value: float, form: str) -> str:
    """The number, or a dash of the same width for NaN."""
    text = format(value if math.isfinite(value) else 0.0, form)
    if not math.isfinite(value):
        return "-".rjust(len(text))
    return text if float(text) else format(0.0, form)  # no -0


# Names for numbers and codes of vehicle and applet; clear without colour.


MODES = {**vehicle_modes.MODES, 16: "STARTING"}  # short enough for the head of a screen
# GPS_FIX_TYPE (MAVLink common)
FIXES = {0: "no GPS", 1: "no fix", 2: "2D fix", 3: "3D fix", 4: "DGPS", 5: "RTK float", 6: "RTK fixed"}
# state of a check: (sign, word)
CHECKS = {
    "good": ("✓", "good"),
    "doubtful": ("?", "doubtful"),
    "bad": ("✗", "BAD"),
    "unknown": ("·", "unknown"),
}
APPLET = {
    0: "idle",
    1: "records standstill",
    2: "waits for speed",
    3: "straight, before",
    4: "fades in",
    5: "dwells at w_min",
    6: "steers",
    7: "fades out",
    8: "straight, after",
    9: "records standstill",
    10: "stopped",
}
ADVICE = {"keep": ("✓", "KEEP"), "repeat": ("↻", "REPEAT"), "discard": ("✗", "DISCARD")}
OUTCOMES = {
    "asked": ("·", "requested"),
    "running": ("▶", "running"),
    "done": ("✓", "complete"),
    "stopped": ("✗", "stopped"),
    "failed": ("✗", "failed"),
}
RESPONSES = {"r": "yaw rate", "ay": "lateral acc.", "vydot": "vydot", "p": "roll rate"}


def mode_label(custom_mode: int) -> str:
    """Name of a Rover mode."""
    return MODES.get(custom_mode, "mode ?" if custom_mode < 0 else f"mode {custom_mode}")


def switch_label(pwm: float) -> str:
    """Position of a switch as the firmware reads it: low, in the middle or high."""
    if not math.isfinite(pwm) or pwm <= 0:
        return "?"
    return "LOW" if pwm < SWITCH_LOW else "HIGH" if pwm > SWITCH_HIGH else "MIDDLE"


def manoeuvre(m: Manoeuvre) -> str:
    """A manoeuvre in one line."""
    about = f" about {m.middle:+g}" if isinstance(m, Sweep) and m.middle else ""
    kind = "throttle sweep" if m.kind == "throttle" else m.kind.replace("_", " ")
    if isinstance(m, Sweep | Multisine):
        return f"{kind} ±{m.amplitude:g} us{about}, {m.w_min:g} to {m.w_max:g} rad/s"
    assert isinstance(m, Doublet)
    return f"{kind} ±{m.amplitude:g} us, {m.count} of {m.pulse:g} s"


def size(count: int) -> str:
    """A number of bytes in kB or MB."""
    return f"{count / 1e6:.1f} MB" if count >= 1e5 else f"{count / 1e3:.0f} kB"


def seconds(value: float) -> str:
    """A duration in s, or in min and s."""
    return f"{value:.0f} s" if value < 100 else f"{int(value) // 60} min {int(value) % 60:02d} s"


def ago(seconds: float) -> str:
    """How long ago something was; "" for less than 10 s."""
    if seconds < 10:
        return ""
    return f"{seconds // 10 * 10:.0f} s ago" if seconds < 120 else f"{seconds // 60:.0f} min ago"


# Words in large letters, three or five rows high, readable from a distance.


_DOTS = {
    "A": "01110 10001 11111 10001 10001",
    "B": "11110 10001 11110 10001 11110",
    "C": "1111 1000 1000 1000 1111",
    "D": "1110 1001 1001 1001 1110",
    "E": "1111 1000 1110 1000 1111",
    "F": "1111 1000 1110 1000 1000",
    "G": "1111 1000 1011 1001 1111",
    "H": "1001 1001 1111 1001 1001",
    "I": "1 1 1 1 1",
    "J": "0001 0001 0001 1001 1111",
    "K": "1001 1010 1100 1010 1001",
    "L": "1000 1000 1000 1000 1111",
    "M": "10001 11011 10101 10001 10001",
    "N": "10001 11001 10101 10011 10001",
    "O": "1111 1001 1001 1001 1111",
    "P": "1111 1001 1111 1000 1000",
    "Q": "1111 1001 1001 1011 1111",
    "R": "1111 1001 1111 1010 1001",
    "S": "1111 1000 1111 0001 1111",
    "T": "11111 00100 00100 00100 00100",
    "U": "1001 1001 1001 1001 1111",
    "V": "10001 10001 01010 01010 00100",
    "W": "10001 10001 10101 11011 10001",
    "X": "10001 01010 00100 01010 10001",
    "Y": "10001 01010 00100 00100 00100",
    "Z": "1111 0001 0110 1000 1111",
    " ": "00 00 00 00 00",
    "?": "1111 0001 0110 0000 0100",
}
_BLOCKS = {"00": " ", "10": "▀", "01": "▄", "11": "█"}


def big(words: str) -> tuple[str, str, str]:
    """Three rows of equal length, one dot per half block; skips unknown letters."""
    rows = (*_rows(words), "0" * len(_rows(words)[0]))
    return (_pair(rows[0], rows[1]), _pair(rows[2], rows[3]), _pair(rows[4], rows[5]))


def huge(words: str) -> tuple[str, ...]:
    """Five rows, one dot per two columns."""
    return tuple("".join("██" if dot == "1" else "  " for dot in row) for row in _rows(words))


def _rows(words: str) -> tuple[str, ...]:
    """Five rows of dots, 0 and 1."""
    letters = [_DOTS[letter].split() for letter in words.upper() if letter in _DOTS]
    return tuple("0".join(letter[n] for letter in letters) for n in range(5))


def _pair(upper: str, lower: str) -> str:
    return "".join(_BLOCKS[a + b] for a, b in zip(upper, lower, strict=True))


# Two sets of colours; every text has a WCAG 2.1 contrast of 7 or more to its ground (1.4.6, AAA).
#
# Black on white for the sun, white on black for dusk. Colour is never the only sign: there
# is always a word too (`labels.py`).


@dataclass(frozen=True)
class Palette:
    """Colours as #rrggbb. alarm: (text, background) of the ABORT bar and of alarms."""

    name: str
    ink: str
    ground: str
    quiet: str
    good: str
    doubtful: str
    bad: str
    accent: str
    alarm: tuple[str, str]

    @property
    def inverse(self) -> str:
        """Style of the chosen row."""
        return f"bold {self.ground} on {self.ink}"

    @property
    def alarming(self) -> str:
        return f"bold {self.alarm[0]} on {self.alarm[1]}"

    @property
    def asking(self) -> str:
        """Style of a request to the pilot."""
        return f"bold {self.ground} on {self.accent}"


LIGHT = Palette(
    "light",
    "#000000",
    "#ffffff",
    "#404040",
    "#005000",
    "#5c3a00",
    "#900000",
    "#00308f",
    ("#ffffff", "#900000"),
)
DARK = Palette(
    "dark",
    "#ffffff",
    "#000000",
    "#c8c8c8",
    "#5cff5c",
    "#ffd75f",
    "#ff9c9c",
    "#7fd7ff",
    ("#ffffff", "#900000"),
)


# A question before something that moves or reboots the rover, answered by one key.


LEAST = 40  # columns of a question that can be read
YES = "y"  # not SPACE or ENTER, which are easily pressed by mistake


T = TypeVar("T")


class Box(ModalScreen[T]):
    """A frame in the middle, over a view that it hides."""

    DEFAULT_CSS = """
    Box { align: center middle; background: $background; }
    Box > Vertical { width: 72; max-width: 100%; height: auto; border: heavy $foreground; padding: 1 2; }
    Box Static { width: 100%; height: auto; }
    """


class Question(Box[bool]):
    """Y is yes; every other key is no. So is Y in a window that is too small to show the whole question."""

    CSS = "Question #yes { text-style: bold reverse; margin-top: 1; }"

    def __init__(self, question: str, yes: str) -> None:
        super().__init__()
        self._question, self._yes = printable_lines(question), printable_lines(yes)

    def compose(self) -> ComposeResult:
        with Vertical():
            yield Static(self._question, markup=False)
            yield Static(f" Y  {self._yes}", id="yes", markup=False)
            yield Static(" any other key: no, nothing happens", markup=False)

    def on_key(self, event: events.Key) -> None:
        event.stop()
        box = self.query_one(Vertical).region
        self.dismiss(event.key.lower() == YES and box in self.region and box.width >= LEAST)


Part = str | tuple[str, str]


class ScreenRows:
    """Rows of a screen. palette gives the styles; width in columns, height in rows."""

    def __init__(self, palette: Palette, width: int, height: int) -> None:
        self.palette, self.width, self.height = palette, width, height
        self._rows: list[Text] = []

    @property
    def left(self) -> int:
        """Number of free rows."""
        return self.height - len(self._rows)

    def add(self, *parts: Part, style: str = "") -> ScreenRows:
        """Add a row of parts, text or (text, style), cut at the width."""
        row = Text.assemble(*parts, style=style, no_wrap=True)
        row.truncate(self.width)
        self._rows.append(row)
        return self

    def filled(self, text: str, style: str) -> ScreenRows:
        """Add a row with a coloured background over the whole width."""
        return self.add((text[: self.width].ljust(self.width), style))

    def listed(self, text: str, chosen: bool) -> ScreenRows:
        """Add a row of a list; the chosen one is inverse."""
        return self.filled(text, self.palette.inverse) if chosen else self.add(text, style=self.palette.ink)

    def blank(self, count: int = 1) -> ScreenRows:
        """Add empty rows, as far as there is room."""
        for _ in range(min(count, max(0, self.left))):
            self.add("")
        return self

    def sentence(
        self, text: str, style: str = "", indent: int = 1, most: int = 99, below: int | None = None
    ) -> ScreenRows:
        """Add text wrapped at the width, in at most `most` rows.

        below: rows that the content after it needs; others may be used too, even beyond `most`.
        """
        if below is not None:
            most = max(most, self.left - below)
        rows = wrapped(text, self.width - 2 * indent)
        if len(rows) > most:
            rows = [*rows[: most - 1], rows[most - 1][: self.width - 2 * indent - 2] + " …"]
        for row in rows:
            self.add((" " * indent + row, style))
        return self

    def down_to(self, row: int) -> ScreenRows:
        """Add empty rows until `row` is the next."""
        return self.blank(row - len(self._rows))

    def text(self) -> Text:
        """All rows as one text, cut at the height."""
        return Text("\n").join(self._rows[: self.height])


def harmless(picture: Text) -> Text:
    """Replace control characters by U+FFFD before drawing; styles and columns stay."""
    if (plain := same_length(picture.plain)) != picture.plain:
        picture.plain = plain
    return picture


def wrapped(text: str, width: int) -> list[str]:
    """Rows of wrapped text; keeps its line breaks."""
    return [row for line in text.splitlines() for row in textwrap.wrap(line, max(10, width))]


def cells(values: Sequence[str], widths: Sequence[int]) -> str:
    """Text in columns; a negative width aligns right, and a text that is too long is cut."""
    cut = (v if len(v) <= abs(w) else v[: abs(w) - 1] + "…" for v, w in zip(values, widths, strict=True))
    return " ".join(v.rjust(-w) if w < 0 else v.ljust(w) for v, w in zip(cut, widths, strict=True))


def cut_line(line: str, width: int) -> str:
    """The line, with a sign at its end where it is cut: after a word if one ends in the last 20 columns."""
    if len(line) <= width:
        return line
    words = line[: width - 1].rpartition(" ")[0]
    return f"{words} …" if len(words) > width - 20 else f"{line[: width - 1]}…"


def in_rows(text: str, width: int, most: int) -> str:
    """The text in at most `most` rows, each a column in; the last one cut if it is too long."""
    rows = wrapped(text, width - 2)
    kept, rest = rows[: most - 1], rows[most - 1 :]
    return "\n".join(cut_line(f" {row}", width) for row in (*kept, *([" ".join(rest)] if rest else [])))


def window(count: int, chosen: int, room: int) -> range:
    """The range of at most `room` of `count` rows that contains the chosen one."""
    if count <= room:
        return range(count)
    first = min(max(0, chosen - room // 2), count - room)
    return range(first, first + room)


def moved(index: int, step: int, count: int) -> int:
    """The index `step` further in a list of `count`, which ends at both ends; 0 in an empty one."""
    return max(0, min(index + step, count - 1))
