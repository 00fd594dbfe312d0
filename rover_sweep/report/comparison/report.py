"""The report of a comparison, or of a corrected simulation: its document, its charts, its folder."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from rover_sweep.comparison.answer import Bode, Comparison, Twin, TwinDrive
from rover_sweep.data.codec import encoded, in_json
from rover_sweep.diagnosis.result import TimeHistory
from rover_sweep.files.replaced import write_file
from rover_sweep.report.charts.chart import ChartPlan
from rover_sweep.report.charts.diagnosis_charts import bode_chart, overlay_chart
from rover_sweep.report.comparison.difference_tables import (
    agreement_table,
    correction_table,
    could_differ_table,
    difference_table,
    place_table,
    rounds_table,
)
from rover_sweep.report.document import (
    Badge,
    Document,
    Figures,
    Level,
    Part,
    Section,
    Sentence,
    Tone,
    items,
    made_words,
    small_print,
    some,
)
from rover_sweep.report.in_html import in_html
from rover_sweep.report.wording import Provenance, plain, sentence, strict_json

PREDICTED = "the simulation plus what the differences change"
AGAIN = "the corrected simulation, driven again"


def comparison_report(found: Comparison, provenance: Provenance) -> Document:
    """A comparison as a document."""
    verdict = f"simulation and recordings {found.verdict}"
    alike = (
        f"instead of {d.name}, these explain it as well: {', '.join(d.look_alikes)}"
        for d in found.differences
        if d.look_alikes
    )
    histories = planned_histories(found.overlays, PREDICTED)
    return Document(
        _title(provenance, "simulation and recordings"),
        made_words(provenance),
        some(
            Sentence(
                sentence(found.sentence), "strong", badge=Badge(verdict, _tone(found.verdict == "agree"))
            ),
            *items([sentence(d.sentence) for d in found.differences]),
            *(Sentence(sentence(words)) for words in alike),
            *items([sentence(i.sentence) for i in found.instruments]),
        ),
        (
            Section("What differs", _differences(found), "differences"),
            Section("Where they differ", some(place_table(found.places)), "where"),
            Section("Each run", some(agreement_table(found.agreement)), "runs"),
            Section("Responses", some(Figures(planned_responses(found.bode, PREDICTED))), "bode"),
            Section("Time histories", some(Figures(histories)), "histories"),
            Section(
                "What could still differ unseen", some(could_differ_table(found)), "hidden", level="page"
            ),
            Section("Remarks", items([sentence(r) for r in found.remarks]), "remarks"),
        ),
        foot=small_print(provenance),
    )


def _differences(found: Comparison) -> tuple[Part, ...]:
    differ = replace(difference_table(found.differences, "Differences"), level="page")
    return some(differ, difference_table(found.minor, "Smaller than the normal tolerance"))


def twin_report(found: Twin, provenance: Provenance) -> Document:
    """A corrected simulation as a document, before and after."""
    verdict = "twin agrees" if found.agrees else "twin still differs"
    levels: tuple[Level, ...] = ("terminal", "page")
    corrected = (correction_table(found.corrections, level) for level in levels)
    left = [sentence(words) for words in (*found.left, *found.remarks)]
    first, last = (found.rounds[k].comparison for k in (0, -1))
    return Document(
        _title(provenance, "the corrected simulation"),
        made_words(provenance),
        (Sentence(sentence(found.sentence), "strong", badge=Badge(verdict, _tone(found.agrees))),),
        (
            Section("What was corrected", some(*corrected), "corrected"),
            Section("Drive by drive", some(rounds_table(found.rounds)), "rounds"),
            Section(
                "Responses before and after", some(Figures(planned_responses(found.bode, AGAIN))), "bode"
            ),
            Section(
                "Time histories before and after",
                some(Figures(planned_histories(found.overlays, AGAIN))),
                "histories",
            ),
            Section("Before the correction", _round(first), "before", level="page"),
            Section("After the correction", _round(last), "after", level="page"),
            Section("Remarks", items(left), "remarks"),
        ),
        foot=small_print(provenance),
    )


def _round(found: Comparison) -> tuple[Part, ...]:
    return some(
        Sentence(sentence(found.sentence)),
        difference_table((*found.differences, *found.minor), "Differences"),
        place_table(found.places),
        agreement_table(found.agreement),
    )


def _title(provenance: Provenance, what: str) -> str:
    return f"{provenance.vehicle.name if provenance.vehicle else 'Rover'}: {what}"


def _tone(good: bool) -> Tone:
    return "good" if good else "warn"


# The pictures of a comparison and of a corrected simulation.


OVERLAY = (
    "Time history with the residual (recorded minus simulated), a close-up, and the residual's spectrum "
    "divided by the noise of both sides. Dashed: twice that noise."
)
BODE = "Responses to the steering. White: where the recording is coherent."


def planned_histories(overlays: Sequence[TimeHistory], after: str) -> tuple[ChartPlan, ...]:
    """Time histories, not made yet. after: what `after` is, in words."""
    by_run: dict[tuple[str, bool], list[TimeHistory]] = {}
    for o in overlays:
        by_run.setdefault((o.run, o.held_out), []).append(o)
    return tuple(
        ChartPlan(
            f"overlay-{k}",
            f"{run}, {_role(held_out)}. Before: the simulation; after: {after}. {OVERLAY}",
            partial(overlay_chart, tuple(channels)),
        )
        for k, ((run, held_out), channels) in enumerate(by_run.items())
    )


def planned_responses(responses: Sequence[Bode], after: str) -> tuple[ChartPlan, ...]:
    """Responses to the steering, not made yet."""
    if not responses:
        return ()
    first = responses[0]
    caption = f"{first.run}, {_role(first.held_out)}. Before: the simulation; after: {after}. {BODE}"
    return (ChartPlan("bode", caption, partial(bode_chart, tuple(responses))),)


def _role(held_out: bool) -> str:
    return "held out" if held_out else "used"


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


def write_comparison(found: Comparison, directory: Path, provenance: Provenance) -> Path:
    """Write comparison.html and comparison.json; the path of the page. UsageError if it is not writable."""
    page = in_html(comparison_report(found, provenance))
    document = strict_json(comparison_document(found, provenance))
    html = write_file(directory / "comparison.html", page)
    write_file(directory / "comparison.json", document)
    return html


def write_twin(found: Twin, directory: Path, provenance: Provenance) -> Path:
    """Write twin.html, variant.toml and twin.json; the path of the page."""
    page = in_html(twin_report(found, provenance))
    document = strict_json(twin_document(found, provenance))
    write_file(directory / "variant.toml", found.variant)
    html = write_file(directory / "twin.html", page)
    write_file(directory / "twin.json", document)
    return html
