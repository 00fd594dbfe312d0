"""A comparison, and a corrected simulation, for the terminal."""

from __future__ import annotations

from collections.abc import Iterator

from rich.console import Group, RenderableType
from rich.text import Text

from rover_sweep.comparison.answer import Comparison
from rover_sweep.comparison.corrected import Twin
from rover_sweep.report.comparison.difference_tables import (
    agreement_table,
    correction_table,
    difference_table,
    place_table,
    rounds_table,
)
from rover_sweep.report.identification.terminal import Sentence, rich_table
from rover_sweep.report.wording.effect_names import sentence


def comparison_summary(found: Comparison) -> Group:
    """The answer, the differences, where they show, and the runs."""
    return Group(*_spaced(_compared(found)))


def twin_summary(found: Twin) -> Group:
    """The answer, what was corrected, and each run drive by drive."""
    return Group(*_spaced(_corrected(found)))


def _spaced(parts: Iterator[RenderableType]) -> Iterator[RenderableType]:
    for k, part in enumerate(parts):
        if k:
            yield Text("")
        yield part


def _compared(found: Comparison) -> Iterator[RenderableType]:
    style = "bold green" if found.verdict == "agree" else "bold yellow"
    yield Group(Text("SIMULATION AND RECORDINGS", style), Sentence(sentence(found.sentence), "bold"))
    if found.differences:
        yield Group(*(_hanging(d.sentence) for d in found.differences))
    for d in found.differences:
        if d.look_alikes:
            yield Sentence(
                sentence(f"instead of {d.name}, these explain it as well: {', '.join(d.look_alikes)}")
            )
    if found.instruments:
        yield Group(*(_hanging(i.sentence) for i in found.instruments))
    if found.places:
        yield rich_table(place_table(found.places))
    if found.minor:
        yield rich_table(difference_table(found.minor, "Smaller than the normal tolerance"))
    yield rich_table(agreement_table(found.agreement))
    if found.remarks:
        yield Group(*(_hanging(remark) for remark in found.remarks))


def _corrected(found: Twin) -> Iterator[RenderableType]:
    style = "bold green" if found.agrees else "bold yellow"
    yield Group(
        Text("TWIN AGREES" if found.agrees else "TWIN STILL DIFFERS", style),
        Sentence(sentence(found.sentence), "bold"),
    )
    if found.corrections:
        yield rich_table(correction_table(found.corrections))
    yield rich_table(rounds_table(found.rounds))
    if found.left or found.remarks:
        yield Group(*(_hanging(words) for words in (*found.left, *found.remarks)))


def _hanging(text: str) -> Sentence:
    return Sentence(sentence(text), first="- ", rest="  ")
