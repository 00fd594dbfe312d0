"""Text files with a table of numbers: where its rows begin and end, and the names and units of its columns.

The rows are found by what repeats, in the middle of the file: the delimiter that gives rows of one width, and
the columns that hold numbers. Text of any number of lines and any length may lie above and below.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rover_sweep.data.recording import Note
from rover_sweep.errors import DataRefused
from rover_sweep.logs.readers.column_names import UNIT_WORDS, words_of
from rover_sweep.logs.readers.date_times import is_value

Row = list[str]
SAMPLE = 200  # lines from the middle of a file, which show how its rows look
FOLLOWING = 10  # lines from the first row of the table on, of which most are rows of numbers
MOSTLY = 0.8  # share of the lines, or of the cells of a column, that show what the others are
CUT = 0.01  # share of rows of another width, up to which they are left out as damaged
DELIMITERS = ";\t,|"  # a comma may be the decimal sign between the others
_DECIMAL_COMMA = re.compile(r"\s*[-+]?\d*,\d+(?:[eE][-+]?\d+)?\s*").fullmatch


@dataclass(frozen=True)
class TextTable:
    """names of the columns, with their units in brackets; cells: as many lists of (n,) cells."""

    names: tuple[str, ...]
    cells: tuple[list[str], ...]
    notes: tuple[Note, ...]


@dataclass(frozen=True)
class _Shape:
    """How the rows of a table look. numeric: the columns that hold numbers or dates."""

    delimiter: str
    width: int
    numeric: tuple[int, ...]

    def holds(self, row: Row) -> bool:
        """True for a row of values: most of the columns of numbers hold one, and few hold text."""
        if len(row) != self.width:
            return False
        cells = [row[k] for k in self.numeric if row[k].strip()]
        values = sum(map(is_value, cells))
        return values > 0 and 2 * values > len(cells)


def read_text_table(path: Path) -> TextTable:
    """The table in a text file; its columns are column 1, 2, ... where nothing names them.

    DataRefused for a file that is empty, not a text, or holds no rows of one width.
    """
    lines = _text(path).splitlines()
    if not any(line.strip() for line in lines):
        raise DataRefused(f"{path.name} is empty: its first line must name the columns")
    try:
        shape = _shape(lines)
        whole = list(csv.reader(lines, delimiter=shape.delimiter, strict=True))
    except csv.Error as error:  # after an open quote the rest of the file is one cell
        raise DataRefused(
            f"{path.name} is not a table of numbers ({error}); is a quote not closed?"
        ) from error
    numbered = [(n, row) for n, row in enumerate(whole, 1) if any(row)]
    begin = _begin(numbered, shape)
    head, body = numbered[:begin], numbered[begin:]
    if not body:
        raise DataRefused(f"{path.name} has a header but no rows")
    names, line, notes = _names(path.name, head, body, shape)
    kept, lost = _whole(path.name, body, shape)
    if lost:
        notes.append(lost)
    rows = [row for _, row in kept]
    if shape.delimiter != ",":
        rows = [[cell.replace(",", ".") if _DECIMAL_COMMA(cell) else cell for cell in row] for row in rows]
    if line > 1:
        words = f"{path.name}: the names of its columns are in line {line}"
        notes.insert(0, Note("info", words))
    used = [k for k, name in enumerate(names) if name or any(row[k].strip() for row in rows)]
    cells = tuple([row[k] for row in rows] for k in used)
    return TextTable(tuple(names[k] or f"column {k + 1}" for k in used), cells, tuple(notes))


def _text(path: Path) -> str:
    """The text of a file in UTF-8, in UTF-16 as of Excel, or in the character set of western Windows."""
    content = path.read_bytes()
    try:
        if content.startswith((b"\xff\xfe", b"\xfe\xff")):
            return content.decode("utf-16")
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        text = content.decode("cp1252", errors="replace")
        if "\ufffd" not in text and all(sign.isprintable() or sign.isspace() for sign in set(text)):
            return text
        raise DataRefused(f"{path.name} is not a text file: {error.reason} at byte {error.start}") from error


def _shape(lines: Sequence[str]) -> _Shape:
    """The delimiter, width and columns of numbers of most lines in the middle."""
    middle = len(lines) // 2 if len(lines) > 2 else 0
    sample = [line for line in lines[middle : middle + SAMPLE] if line.strip()] or [*lines]
    found: list[tuple[str, int, list[Row]]] = []
    for sign in DELIMITERS:
        rows = [row for row in csv.reader(sample, delimiter=sign) if any(row)]
        widths = [len(row) for row in rows]
        width = max(widths, key=widths.count, default=1)
        found.append((sign, width, [row for row in rows if len(row) == width]))
        if width > 1 and widths.count(width) >= MOSTLY * len(widths):
            break
    else:
        found.append(max(found[::-1], key=lambda each: each[1]))
    delimiter, width, rows = found[-1]

    def holds_values(k: int) -> bool:
        cells = [_point(row[k], delimiter) for row in rows if row[k].strip()]
        return bool(cells) and sum(map(is_value, cells)) >= MOSTLY * len(cells)

    return _Shape(delimiter, width, tuple(k for k in range(width) if holds_values(k)))


def _point(cell: str, delimiter: str) -> str:
    return cell.replace(",", ".") if delimiter != "," and _DECIMAL_COMMA(cell) else cell


def _begin(numbered: Sequence[tuple[int, Row]], shape: _Shape) -> int:
    """Index of the first row of values of which most lines that follow are rows of values."""
    holds = [shape.holds([_point(cell, shape.delimiter) for cell in row]) for _, row in numbered[:2000]]
    for k in range(len(holds)):
        following = holds[k : k + FOLLOWING]
        if holds[k] and sum(following) >= MOSTLY * len(following):
            return k
    return 1  # no numbers: one line of names, and a refusal later


def _names(
    file: str, head: Sequence[tuple[int, Row]], body: Sequence[tuple[int, Row]], shape: _Shape
) -> tuple[list[str], int, list[Note]]:
    """(names with units, the line that they are in, notes). DataRefused for names of another number."""
    above: list[tuple[int, Row]] = []
    for line, row in reversed(head):
        fitted = _fitted(row, shape.width)
        if fitted is None:
            break
        above.insert(0, (line, fitted))
    if not above:
        texts = [row for _, row in head if sum(bool(cell.strip()) for cell in row) > 1]
        if texts and len(head) - head.index(next(h for h in head if h[1] is texts[-1])) == 1:
            wanted, line = len(texts[-1]), body[0][0]
            raise DataRefused(f"{file}: line {line} has {shape.width} of {wanted} columns")
        words = f"{file} has no names of columns; they are column 1, column 2, ..."
        return [f"column {k + 1}" for k in range(shape.width)], 0, [Note("info", words)]
    line, names = max(reversed(above), key=lambda each: _named(each[1]) - _united(each[1]))
    units = max((row for n, row in above if n != line), key=_united, default=[])
    if _united(units) > 0 or (units and len(above) == 2 and above[0][0] == line):
        names = [
            f"{n} [{u}]" if (u := unit.strip(" []()")) else n for n, unit in zip(names, units, strict=True)
        ]
    return names, line, []


def _fitted(row: Row, width: int) -> Row | None:
    """The stripped cells of a line above the rows, with as many as these have; None where they do not fit.

    Some exporters end each row, or the line of the names, with a delimiter.
    """
    cells = [cell.strip() for cell in row]
    while len(cells) > width and not cells[-1]:
        cells.pop()
    if len(cells) == width - 1 and width > 2:
        cells.append("")
    return cells if len(cells) == width else None


def _named(row: Row) -> float:
    """Share of the cells that are texts of their own, as names are."""
    return len({cell for cell in row if cell and not is_value(cell)}) / len(row)


def _united(row: Row) -> float:
    """Share of the cells that are units, or hold nothing else."""
    known = [cell for cell in row if words_of(cell.strip("[]() ").replace("\u00b2", "2")) in _UNITS]
    return len(known) / max(len(row), 1)


_UNITS = {*UNIT_WORDS, "s", "m", "v", "a", "k", "pa", "bar", "c", "hz", "nm", "n", "w", "1", "sec"}


def _whole(
    file: str, body: Sequence[tuple[int, Row]], shape: _Shape
) -> tuple[list[tuple[int, Row]], Note | None]:
    """(the rows of the right width, a note on the others). DataRefused where these are many."""
    last = len(body)
    while last and len(body[last - 1][1]) != shape.width:
        last -= 1
    inside, below = body[:last], body[last:]
    wrong = [each for each in inside if len(each[1]) != shape.width]
    if len(wrong) > CUT * len(inside) or (below and len(inside) < len(below)):
        line, row = (wrong or [*below])[0]
        raise DataRefused(f"{file}: line {line} has {len(row)} of {shape.width} columns")
    lost = [*wrong, *below]
    if not lost:
        return list(inside), None
    count = f"{len(lost)} lines have" if len(lost) > 1 else "1 line has"
    first = f"the first is line {lost[0][0]}, with {len(lost[0][1])} of {shape.width}"
    text = f"{file}: {count} another number of columns and were left out; {first}"
    return [each for each in inside if len(each[1]) == shape.width], Note("warning", text)
