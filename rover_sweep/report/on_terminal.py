"""A document on a terminal, as rich renderables."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterator, Sequence

import numpy as np
from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.table import Table as RichTable
from rich.text import Text

from rover_sweep.data.braille import braille_lines
from rover_sweep.data.results import number
from rover_sweep.report.charts.chart import Stack
from rover_sweep.report.document import Document, Figures, Level, Part, Section, Sentence, Table, Terms, shown

STYLES = {"": "", "good": "green", "warn": "yellow", "bad": "bold red", "muted": "dim", "strong": "bold"}
BADGES = {"good": "bold green", "warn": "bold yellow", "bad": "bold red"}
WIDTH = 80  # characters of running text and tables of a diagnosis
PLOT = (44, 7)  # characters and rows of a chart


def on_terminal(document: Document, full: bool = False, answer_last: bool = False) -> Group:
    """The document for `Console.print`. full: with the parts of level full; answer_last: at the prompt."""
    levels: tuple[Level, ...] = ("brief", "terminal", "full") if full else ("brief", "terminal")
    answer = list(_drawn(document.answer, levels))
    own = [part for section in shown(document.sections, levels) for part in section.parts]
    sections = list(_drawn(own, levels))
    parts = [*sections, *answer] if answer_last else [*answer, *sections]
    return Group(*_spaced(parts))


def rich_table(table: Table, titled: bool = True) -> RenderableType:
    """A table with its title above and its note below."""
    headed = any(table.headings)
    made = RichTable(box=None, padding=(0, 2, 0, 0), header_style="dim", pad_edge=False, show_header=headed)
    for k, (heading, words) in enumerate(zip(table.headings, table.words, strict=True)):
        made.add_column(heading, justify="left" if words else "right", no_wrap=not words or k == 0)
    for row in table.rows:
        made.add_row(*(Text(cell.text, STYLES[cell.tone]) for cell in row))
    note = (Wrapped(table.note, "dim"),) if table.note else ()
    title = (Wrapped(table.title, "bold"),) if titled else ()  # separate: rich would wrap it to the table
    return Group(*title, made, *note)


class Wrapped:
    """Text wrapped to the console; a number keeps its % sign, a <= its number. first, rest: indents."""

    def __init__(self, text: str, style: str = "", first: str = "", rest: str = "") -> None:
        self.text, self.style, self.first, self.rest = text, style, first, rest

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Wraps the text here, so that the console does not wrap it again."""
        glued = re.sub(r"(?<=\d) (?=%)|(?<=[≤≥=<>]) (?=\d)", "\N{NO-BREAK SPACE}", self.text)
        lines = textwrap.wrap(
            glued,
            options.max_width,
            initial_indent=self.first,
            subsequent_indent=self.rest,
            break_long_words=False,
            break_on_hyphens=False,
        )
        yield Text("\n".join(lines).replace("\N{NO-BREAK SPACE}", " "), self.style)


def _spaced(blocks: Sequence[tuple[bool, RenderableType]]) -> Iterator[RenderableType]:
    """An empty line between blocks, none between sentences."""
    for k, (sentence, block) in enumerate(blocks):
        if k and not (sentence and blocks[k - 1][0]):
            yield Text("")
        yield block


def _drawn(
    parts: Sequence[Part], levels: Sequence[Level], titled: bool = True
) -> Iterator[tuple[bool, RenderableType]]:
    """(whether it is a sentence, the part as shown). titled: tables with their titles."""
    for part in shown(parts, levels):
        match part:
            case Sentence():
                yield True, _sentence(part)
            case Table():
                yield False, rich_table(part, titled)
            case Terms():
                yield False, Group(*(Wrapped(f"{term}: {words}", "dim") for term, words in part.rows))
            case Figures():
                for chart in part.charts:
                    yield from ((False, _plot(stack)) for stack in chart.make().stacks)
            case Section():
                yield False, Group(*_section(part, levels))


def _sentence(part: Sentence) -> RenderableType:
    words = Wrapped(part.text, STYLES[part.tone], *(("- ", "  ") if part.item else ()))
    if part.badge is None:
        return words
    return Group(Text(part.badge.text.upper(), BADGES.get(part.badge.tone, "bold")), words)


def _section(part: Section, levels: Sequence[Level]) -> Iterator[RenderableType]:
    if part.heading:
        words = f" ({', '.join(badge.text for badge in part.badges)})" if part.badges else ""
        yield Text(f"{part.heading}{words}", "bold")
    tables = [p for p in shown(part.parts, levels) if isinstance(p, Table)]
    yield from _spaced(list(_drawn(part.parts, levels, not part.heading or len(tables) > 1)))


def _plot(stack: Stack) -> Group:
    """The lines and the ends of the bands of a stack's first panel, in dots."""
    panel, across = stack.panels[0], stack.span
    drawn = [line.y for line in panel.lines] if not panel.spreads else [panel.lines[-1].y]
    drawn += [end for s in panel.spreads for end in (s.low, s.high)]
    lines = [(panel.x[np.isfinite(y)].tolist(), y[np.isfinite(y)].tolist()) for y in drawn]
    up = min(min(y) for _, y in lines), max(max(y) for _, y in lines)
    dots = braille_lines(lines, across, up, *PLOT)
    labels = [number(up[1], 2), *[""] * (PLOT[1] - 2), number(up[0], 2)]
    rows = [f"  {label:>8} ┤{line}" for label, line in zip(labels, dots, strict=True)]
    left, right = (number(end, 2) for end in across)
    note = "Both ends of the 90 % band, and a straight line." if panel.spreads else ""
    return Group(
        Text(f"{stack.title}, {panel.label}, over {stack.x_label}", "bold"),
        Text("\n".join([*rows, f"{'':11}{left}{right:>{PLOT[0] - len(left)}}"])),
        Wrapped(note, "dim"),
    )
