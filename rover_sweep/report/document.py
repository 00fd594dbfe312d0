"""A result as a document: one value that terminal, page and notebook show as far as space allows.

Each result has one function that builds its document; `on_terminal` and `in_html` are the renderers.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, TypeVar

from rover_sweep.report.charts.chart import ChartPlan
from rover_sweep.report.wording import Provenance, versions_words

Tone = Literal["", "good", "warn", "bad", "muted", "strong"]
Level = Literal["brief", "full", "page", "terminal"]
"""brief: everywhere. full: on the page, and on a terminal if everything was requested. page, terminal:
only there."""
ON_PAGE: tuple[Level, ...] = ("brief", "full", "page")


@dataclass(frozen=True)
class Badge:
    """A word of judgement, such as a verdict."""

    text: str
    tone: Tone = ""


@dataclass(frozen=True)
class Sentence:
    """One or more sentences. item: of a list; code: a formula, a command or a hash; badge: next to it."""

    text: str
    tone: Tone = ""
    item: bool = False
    code: bool = False
    badge: Badge | None = None
    level: Level = "brief"


@dataclass(frozen=True)
class Cell:
    """A text and its tone: good, warn (outside a guideline), bad (rejected), muted (fixed)."""

    text: str
    tone: Tone = ""
    link: str = ""


Cells = tuple[Cell | str, ...]


@dataclass(frozen=True)
class Table:
    """A table. text_columns: number of left columns with words, or their places; the others have numbers."""

    title: str
    headings: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    note: str = ""
    text_columns: int | tuple[int, ...] = 1
    level: Level = "brief"

    @property
    def words(self) -> tuple[bool, ...]:
        """Whether each column has words."""
        of = self.text_columns
        return tuple(k in of if isinstance(of, tuple) else k < of for k in range(len(self.headings)))


def table_of(
    title: str,
    headings: Sequence[str],
    rows: Iterable[Cells],
    note: str = "",
    text_columns: int | tuple[int, ...] = 1,
    level: Level = "brief",
) -> Table:
    """A table of cells and plain texts."""
    made = tuple(tuple(c if isinstance(c, Cell) else Cell(c) for c in row) for row in rows)
    return Table(title, tuple(headings), made, note, text_columns, level)


@dataclass(frozen=True)
class Terms:
    """Explanations: (term, meaning)."""

    rows: tuple[tuple[str, str], ...]
    level: Level = "page"


@dataclass(frozen=True)
class Figures:
    """Charts, made when the document is shown. small: side by side."""

    charts: tuple[ChartPlan, ...]
    small: bool = False
    level: Level = "page"


@dataclass(frozen=True)
class Section:
    """Parts below a heading; without any it is not shown. anchor: its address on the page, "" for none.

    folded: on the page only the heading is seen at first ("closed"). beside: tables side by side.
    """

    heading: str
    parts: tuple[Part, ...]
    anchor: str = ""
    folded: Literal["", "closed", "open"] = ""
    badges: tuple[Badge, ...] = ()
    beside: bool = False
    level: Level = "brief"


Part = Sentence | Table | Terms | Figures | Section
P = TypeVar("P", bound=Part)


@dataclass(frozen=True)
class Document:
    """A result. answer: shown first; links: (address, words) of other pages; foot: small print."""

    title: str
    subtitle: str
    answer: tuple[Part, ...]
    sections: tuple[Section, ...] = ()
    links: tuple[tuple[str, str], ...] = ()
    foot: tuple[Part, ...] = ()


def some(*parts: Part | None) -> tuple[Part, ...]:
    """The parts that exist, without empty tables, figures and sections."""
    return tuple(part for part in parts if part is not None and _content(part))


def _content(part: Part) -> object:
    match part:
        case Sentence():
            return part.text
        case Table() | Terms():
            return part.rows
        case Figures():
            return part.charts
        case Section():
            return part.parts


def items(texts: Sequence[str], tone: Tone = "", level: Level = "brief") -> tuple[Sentence, ...]:
    """A list of sentences."""
    return tuple(Sentence(text, tone, item=True, level=level) for text in texts if text)


def shown(parts: Sequence[P], levels: Sequence[Level]) -> Iterator[P]:
    """The parts of these levels; a section without any of them is left out."""
    for part in parts:
        if part.level not in levels:
            continue
        if not isinstance(part, Section) or any(True for _ in shown(part.parts, levels)):
            yield part


def charts_of(parts: Sequence[Part]) -> Iterator[ChartPlan]:
    """All charts that a page shows, in its order."""
    for part in shown(parts, ON_PAGE):
        if isinstance(part, Figures):
            yield from part.charts
        elif isinstance(part, Section):
            yield from charts_of(part.parts)


# What the documents of several results say.


ZOOM = (
    "Drag to zoom, double-click for the whole range, Ctrl and wheel to zoom at the cursor, ◀ ▶ to move; on a "
    "phone: pinch and drag. The values under the cursor stand below each panel."
)


def made_words(provenance: Provenance) -> str:
    """When a report was made, and by which version."""
    made = provenance.made
    when = f"{made[:16].replace('T', ' ')}{' UTC' if made.endswith('+00:00') else ''}, " if made else ""
    return f"{when}rover-sweep {provenance.versions['rover_sweep']}"


def small_print(provenance: Provenance) -> tuple[Sentence, ...]:
    """Versions, vehicle file and command, for the end of a page."""
    source = provenance.vehicle_source
    file = f"{source[0]}: sha256 {source[1]}" if source else ""
    codes = [Sentence(words, "muted", code=True) for words in (file, provenance.command) if words]
    return Sentence(versions_words(provenance.versions), "muted"), *codes
