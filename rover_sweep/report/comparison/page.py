"""A comparison, or a corrected simulation, as one self-contained HTML page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rover_sweep.comparison.answer import Comparison
from rover_sweep.comparison.corrected import Twin
from rover_sweep.report.charts.shown_chart import ShownChart, by_section
from rover_sweep.report.comparison.difference_tables import (
    agreement_table,
    correction_table,
    could_differ_table,
    difference_table,
    place_table,
    rounds_table,
)
from rover_sweep.report.identification.comparison import Table
from rover_sweep.report.templates import environment
from rover_sweep.report.wording.effect_names import sentence
from rover_sweep.report.wording.provenance import Provenance


@dataclass(frozen=True)
class Part:
    """A section of the page: anchor, heading, tables, section of its pictures, sentences."""

    anchor: str
    heading: str
    tables: tuple[Table, ...] = ()
    pictures: str = ""
    texts: tuple[str, ...] = ()


def comparison_page(found: Comparison, provenance: Provenance, pictures: Sequence[ShownChart]) -> str:
    """The page of a comparison."""
    parts = [p for p in _of_comparison(found) if p.tables or p.pictures or p.texts]
    tone = "good" if found.verdict == "agree" else "warn"
    lines = [d.sentence for d in found.differences]
    return _page(
        "simulation and recordings", (found.sentence, found.verdict, tone), lines, parts, provenance, pictures
    )


def twin_page(found: Twin, provenance: Provenance, pictures: Sequence[ShownChart]) -> str:
    """The page of a corrected simulation, before and after."""
    first, last = found.rounds[0].comparison, found.rounds[-1].comparison
    parts = [
        Part("corrected", "What was corrected", (correction_table(found.corrections, reasons=True),)),
        Part("rounds", "Drive by drive", (rounds_table(found.rounds),)),
        Part("bode", "Responses before and after", pictures="bode"),
        Part("histories", "Time histories before and after", pictures="histories"),
        Part("before", "Before the correction", _tables(first), texts=_sentences(first)),
        Part("after", "After the correction", _tables(last), texts=_sentences(last)),
        Part("remarks", "Remarks", texts=tuple(sentence(t) for t in (*found.left, *found.remarks))),
    ]
    parts = [p for p in parts if p.tables or p.pictures or p.texts]
    answer = (found.sentence, "agrees" if found.agrees else "differs", "good" if found.agrees else "warn")
    return _page("the corrected simulation", answer, [], parts, provenance, pictures)


def _of_comparison(found: Comparison) -> list[Part]:
    differences = [difference_table(found.differences, "Differences")] if found.differences else []
    differences += [difference_table(found.minor, "Smaller than the normal tolerance")] if found.minor else []
    bounds = could_differ_table(found)
    return [
        Part("differences", "What differs", tuple(differences)),
        Part("instruments", "Instruments", texts=tuple(sentence(i.sentence) for i in found.instruments)),
        Part("where", "Where they differ", (place_table(found.places),) if found.places else ()),
        Part("runs", "Each run", (agreement_table(found.agreement),)),
        Part("bode", "Responses", pictures="bode" if found.bode else ""),
        Part("histories", "Time histories", pictures="histories" if found.overlays else ""),
        Part("hidden", "What could still differ unseen", (bounds,) if bounds else ()),
        Part("remarks", "Remarks", texts=tuple(sentence(r) for r in found.remarks)),
    ]


def _tables(found: Comparison) -> tuple[Table, ...]:
    both = (*found.differences, *found.minor)
    out = [difference_table(both, "Differences")] if both else []
    out += [place_table(found.places)] if found.places else []
    return (*out, agreement_table(found.agreement))


def _sentences(found: Comparison) -> tuple[str, ...]:
    return (sentence(found.sentence),)


def _page(
    heading: str,
    answer: tuple[str, str, str],
    lines: Sequence[str],
    parts: Sequence[Part],
    provenance: Provenance,
    pictures: Sequence[ShownChart],
) -> str:
    return (
        environment("report/comparison")
        .get_template("comparison.html.j2")
        .render(
            name=provenance.vehicle.name if provenance.vehicle else "",
            heading=heading,
            answer=sentence(answer[0]),
            verdict=answer[1],
            tone=answer[2],
            lines=[sentence(line) for line in lines],
            sections=[(p.anchor, p.heading) for p in parts],
            parts_list=[(p.anchor, p.heading, p.tables, p.pictures, p.texts) for p in parts],
            provenance=provenance,
            pictures=by_section(pictures),
        )
    )
