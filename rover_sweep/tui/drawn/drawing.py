"""The content of a screen as rows of styled text, cut to a width and a height."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Sequence

from rich.text import Text

from rover_sweep.files.printable import same_length
from rover_sweep.tui.drawn.palette import Palette

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

    def blank(self, count: int = 1) -> ScreenRows:
        """Add empty rows, as far as there is room."""
        for _ in range(min(count, max(0, self.left))):
            self.add("")
        return self

    def sentence(self, text: str, style: str = "", indent: int = 1, most: int = 99) -> ScreenRows:
        """Add text wrapped at the width, in at most `most` rows."""
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


def window(count: int, chosen: int, room: int) -> range:
    """The range of at most `room` of `count` rows that contains the chosen one."""
    if count <= room:
        return range(count)
    first = min(max(0, chosen - room // 2), count - room)
    return range(first, first + room)


def joined(parts: Iterable[str]) -> str:
    """The non-empty parts, separated by spaces."""
    return "   ".join(part for part in parts if part)
