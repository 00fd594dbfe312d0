"""Results that print as a short table: text at a prompt, HTML in a notebook."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from html import escape


@dataclass(frozen=True)
class ShortTable:
    """A title, headings over rows of texts, notes below. First cells are aligned left, others right."""

    title: str
    headings: tuple[str, ...] = ()
    rows: tuple[tuple[str, ...], ...] = ()
    notes: tuple[str, ...] = ()

    def __str__(self) -> str:
        lines = [self.headings, *self.rows] if self.rows else []
        widths = [max(len(line[k]) for line in lines) for k in range(len(self.headings))] if lines else []
        shown = ["  ".join(_aligned(line, widths)).rstrip() for line in lines]
        return "\n".join([self.title, *(f"  {line}" for line in shown), *self.notes])

    def html(self) -> str:
        """The table as an HTML fragment."""
        head = "".join(f"<th>{escape(h)}</th>" for h in self.headings)
        body = "".join(
            "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in self.rows
        )
        table = f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>" if self.rows else ""
        notes = "".join(f"<p>{escape(note)}</p>" for note in self.notes)
        return f"<p><strong>{escape(self.title)}</strong></p>{table}{notes}"


def _aligned(line: tuple[str, ...], widths: list[int]) -> list[str]:
    first, *rest = zip(line, widths, strict=True)
    return [first[0].ljust(first[1]), *(text.rjust(width) for text, width in rest)]


class Shown:
    """Base class of results that print their `table`; dataclasses need repr=False."""

    @abstractmethod
    def table(self) -> ShortTable:
        """The table to print."""

    def __repr__(self) -> str:
        return str(self.table())

    def _repr_html_(self) -> str:
        return self.table().html()


def plain_number(value: float | None, digits: int = 4) -> str:
    """A number with `digits` significant digits, "-" for None."""
    return "-" if value is None else f"{value:.{digits}g}"


def band_words(band: tuple[float, float] | None) -> str:
    """A band as "0.3 - 25", or none."""
    return f"{band[0]:.2g} - {band[1]:.3g}" if band else "none"
