"""The result for the terminal as rich tables, like Tables 2 to 6 of the paper."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterator, Mapping

from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.table import Table as RichTable
from rich.text import Text

from rover_sweep.identification.acceptance import TITLES, ordered
from rover_sweep.identification.model_results import ModelResult
from rover_sweep.identification.pipeline import Identification
from rover_sweep.report.identification.comparison import (
    Table,
    coherence_table,
    cost_table,
    filters_table,
    inertia_table,
    numbers_table,
    parameter_table,
    reduction_table,
    verification_tables,
)
from rover_sweep.report.identification.handling_table import handling_sentence, handling_table
from rover_sweep.report.identification.remarks import (
    diagnosis_remark,
    filters_known,
    filters_remark,
    finding,
    prediction_sentence,
    to_do,
)
from rover_sweep.report.wording.provenance import Provenance
from rover_sweep.report.wording.shown_units import SI, ShownUnits

STYLES = {"": "", "good": "green", "warn": "yellow", "bad": "bold red", "muted": "dim", "strong": "bold"}


class Sentence:
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


def comparison(result: Identification, provenance: Provenance, units: ShownUnits = SI) -> Group:
    """Runs, parameters, costs, verification, inertia, handling and filters, for `Console.print`."""
    return Group(*_spaced(_parts(result, provenance, units)))


def first_numbers(models: Mapping[str, ModelResult]) -> str:
    """The parameters of one model in one line, before the intervals are known; "" without a model."""
    name = next((n for n in ("roll-yaw", "bicycle", *models) if n in models), "")
    if not name:
        return ""
    free = [e for e in models[name].fit.estimates if e.free]
    numbers = ", ".join(f"{e.name} {e.value:.3g} {e.unit}".strip() for e in free)
    return f"first numbers, {name} model: {numbers}; intervals follow"


def short_answer(result: Identification, provenance: Provenance) -> Group:
    """Which model, its numbers with intervals, how it predicts, and what to do first."""
    lines: list[RenderableType] = [rich_table(coherence_table(result)), Text("")]
    if result.recommended and result.recommended in result.models:
        own = parameter_table(result, result.recommended, fixed_rows=False, accuracies=False)
        lines += [rich_table(numbers_table(result) or own), Text("")]
    lines += [Sentence(sentence, "bold") for sentence in result.summary]
    if words := prediction_sentence(result):
        lines.append(Sentence(f"O{words[1:]}"))
    if words := handling_sentence(result):
        lines.append(Sentence(f"{words[0].upper()}{words[1:]}."))
    lines += [Sentence(f"- {sentence}") for sentence in to_do(result, provenance)]
    if words := diagnosis_remark(result):
        lines.append(Sentence(words))
    return Group(*lines)


def conclusion(result: Identification, provenance: Provenance) -> Group:
    """The summary's sentences, the main result, and what to do first."""
    lines = [Sentence(sentence, "bold") for sentence in result.summary]
    if words := finding(result):
        lines.append(Sentence(words))
    lines += [Sentence(f"- {sentence}") for sentence in to_do(result, provenance)]
    if words := diagnosis_remark(result):
        lines.append(Sentence(words))
    return Group(*lines)


def rich_table(table: Table) -> RenderableType:
    """A table with its title above and its note below."""
    shown = RichTable(box=None, padding=(0, 2, 0, 0), header_style="dim", pad_edge=False)
    for k, heading in enumerate(table.headings):
        words = k < table.text_columns
        shown.add_column(heading, justify="left" if words else "right", no_wrap=not words or k == 0)
    for row in table.rows:
        shown.add_row(*(Text(cell.text, STYLES[cell.tone]) for cell in row))
    note = (Sentence(table.note, "dim"),) if table.note else ()
    return Group(
        Sentence(table.title, "bold"), shown, *note
    )  # a separate title, as rich would wrap it to the table


def _parts(result: Identification, provenance: Provenance, units: ShownUnits) -> Iterator[RenderableType]:
    yield rich_table(coherence_table(result))
    for name, model in ordered(result).items():
        yield rich_table(parameter_table(result, name, fixed_rows=False))
        if steps := reduction_table(model):
            yield rich_table(steps)
        yield Sentence(
            f"{TITLES.get(name, name)}: {model.verdict.level}. " + "; ".join(model.verdict.sentences)
        )
    if result.models:
        yield rich_table(cost_table(result))
    for table in verification_tables(result, units):
        yield rich_table(table)
    if inertia := inertia_table(result, provenance):
        yield rich_table(inertia)
    if handling := handling_table(result, units):
        yield rich_table(handling)
    yield from _filters(result)


def _filters(result: Identification) -> Iterator[RenderableType]:
    """The filters, and the fits without them."""
    table = filters_table(result)
    if table is None:
        return
    yield Sentence(filters_known(result))
    yield rich_table(table)
    if remark := filters_remark(result):
        yield Sentence(remark)


def _spaced(parts: Iterator[RenderableType]) -> Iterator[RenderableType]:
    for part in parts:
        yield part
        yield Text("")
