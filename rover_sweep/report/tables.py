"""The comparison for the terminal, as rich tables: the paper's Tables 2 to 6 for this rover."""

from __future__ import annotations

from collections.abc import Iterator

from rich.console import Group, RenderableType
from rich.table import Table as RichTable
from rich.text import Text

from rover_sweep.identify.identification import Identification
from rover_sweep.report.comparison import (
    Table,
    coherence_table,
    cost_table,
    filters_table,
    inertia_table,
    parameter_table,
    reduction_table,
    verification_tables,
)
from rover_sweep.report.handling_table import handling_table
from rover_sweep.report.provenance import Provenance
from rover_sweep.report.remarks import filters_known, filters_remark, finding, to_do
from rover_sweep.report.standing import TITLES, ordered

STYLES = {"": "", "good": "green", "warn": "yellow", "bad": "bold red", "muted": "dim", "strong": "bold"}


def comparison(result: Identification, provenance: Provenance) -> Group:
    """Runs, parameters, costs, verification, inertia and the filters' part, ready for `Console.print`."""
    return Group(*_spaced(_parts(result, provenance)))


def conclusion(result: Identification, provenance: Provenance) -> Group:
    """What to do: the summary's sentences, then what is to be mended first."""
    lines = [Text(sentence, "bold") for sentence in result.summary]
    if words := finding(result):
        lines.append(Text(words))
    lines += [Text(f"- {sentence}") for sentence in to_do(result, provenance)]
    return Group(*lines)


def rich_table(table: Table) -> RenderableType:
    """One table with its title above and its note below."""
    shown = RichTable(title=table.title, title_justify="left", title_style="bold", box=None,
                      padding=(0, 2, 0, 0), header_style="dim")  # fmt: skip
    for k, heading in enumerate(table.headings):
        words = k < table.text_columns
        shown.add_column(heading, justify="left" if words else "right", no_wrap=not words or k == 0)
    for row in table.rows:
        shown.add_row(*(Text(cell.text, STYLES[cell.tone]) for cell in row))
    return Group(shown, Text(table.note, "dim")) if table.note else shown


def _parts(result: Identification, provenance: Provenance) -> Iterator[RenderableType]:
    yield rich_table(coherence_table(result))
    for name, model in ordered(result).items():
        yield rich_table(parameter_table(result, name, fixed_rows=False))
        if steps := reduction_table(model):
            yield rich_table(steps)
        yield Text(f"{TITLES.get(name, name)}: {model.verdict.level}. " + "; ".join(model.verdict.sentences))
    if result.models:
        yield rich_table(cost_table(result))
    for table in verification_tables(result):
        yield rich_table(table)
    if inertia := inertia_table(result, provenance):
        yield rich_table(inertia)
    if handling := handling_table(result):
        yield rich_table(handling)
    if filters := filters_table(result):
        yield Text(filters_known(result))
        yield rich_table(filters)
        yield Text(filters_remark(result) or "")


def _spaced(parts: Iterator[RenderableType]) -> Iterator[RenderableType]:
    for part in parts:
        yield part
        yield Text("")
