"""A comparison, or a corrected simulation, as one self-contained HTML page."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from rover_sweep.comparison.answer import Bode, Comparison, Twin, TwinDrive
from rover_sweep.data.codec import encoded, in_json
from rover_sweep.diagnosis.result import TimeHistory
from rover_sweep.files.replaced import write_file
from rover_sweep.report.charts.chart import ChartPlan
from rover_sweep.report.charts.diagnosis_charts import bode_chart, overlay_chart
from rover_sweep.report.charts.static_svg import ShownChart, by_section, shown_charts
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
from rover_sweep.report.wording import Provenance, plain, sentence, strict_json


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


# The pictures of a comparison and of a corrected simulation.


OVERLAY = (
    "Time history with the residual (recorded minus simulated), a close-up, and the residual's spectrum "
    "divided by the noise of both sides. Dashed: twice that noise."
)
BODE = "Responses to the steering. White: where the recording is coherent."


def planned_pictures(
    overlays: Sequence[TimeHistory], responses: Sequence[Bode], after: str
) -> tuple[ChartPlan, ...]:
    """Time histories and responses, not made yet. after: what `after` is, in words."""
    return (*_histories(overlays, after), *_responses(responses, after))


def _histories(overlays: Sequence[TimeHistory], after: str) -> Iterator[ChartPlan]:
    by_run: dict[tuple[str, bool], list[TimeHistory]] = {}
    for o in overlays:
        by_run.setdefault((o.run, o.held_out), []).append(o)
    for k, ((run, held_out), channels) in enumerate(by_run.items()):
        role, shown = "held out" if held_out else "used", tuple(channels)
        caption = f"{run}, {role}. Before: the simulation; after: {after}. {OVERLAY}"
        yield ChartPlan(f"overlay-{k}", "histories", caption, partial(overlay_chart, shown))


def _responses(responses: Sequence[Bode], after: str) -> Iterator[ChartPlan]:
    if responses:
        first, shown = responses[0], tuple(responses)
        role = "held out" if first.held_out else "used"
        caption = f"{first.run}, {role}. Before: the simulation; after: {after}. {BODE}"
        yield ChartPlan("bode", "bode", caption, partial(bode_chart, shown))


# comparison.json and twin.json: the answers for programs.


PICTURED = ("overlays", "bode")
in_json(Comparison, left_out=PICTURED)
in_json(TwinDrive)
in_json(Twin, left_out=(*PICTURED, "variant"))


def comparison_document(found: Comparison, provenance: Provenance) -> dict[str, Any]:
    """The comparison in plain JSON types. Levels are rms over the noise of both sides together."""
    return plain(_head("rover-sweep comparison", provenance) | encoded(found))


def twin_document(found: Twin, provenance: Provenance) -> dict[str, Any]:
    """All rounds of a corrected simulation, in plain JSON types."""
    own = encoded(found)
    rounds = [r.pop("comparison") | r for r in own["rounds"]]
    return plain(_head("rover-sweep twin", provenance) | own | {"rounds": rounds})


def _head(name: str, provenance: Provenance) -> dict[str, Any]:
    return {
        "format": name,
        "format_version": 1,
        "versions": provenance.versions,
        "command": provenance.command or None,
        "made": provenance.made or None,
    }


# The folders of a comparison and of a corrected simulation.


PREDICTED = "the simulation plus what the differences change"
AGAIN = "the corrected simulation, driven again"


def write_comparison(found: Comparison, directory: Path, provenance: Provenance) -> Path:
    """Write comparison.html and comparison.json; the path of the page. UsageError if it is not writable."""
    pictures = shown_charts(planned_pictures(found.overlays, found.bode, PREDICTED))
    page = comparison_page(found, provenance, pictures)
    document = strict_json(comparison_document(found, provenance))
    html = write_file(directory / "comparison.html", page)
    write_file(directory / "comparison.json", document)
    return html


def write_twin(found: Twin, directory: Path, provenance: Provenance) -> Path:
    """Write twin.html, variant.toml and twin.json; the path of the page."""
    pictures = shown_charts(planned_pictures(found.overlays, found.bode, AGAIN))
    page = twin_page(found, provenance, pictures)
    document = strict_json(twin_document(found, provenance))
    write_file(directory / "variant.toml", found.variant)
    html = write_file(directory / "twin.html", page)
    write_file(directory / "twin.json", document)
    return html
