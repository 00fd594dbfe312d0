"""The report of a comparison, or of a corrected simulation: its document, tables, charts, and its folder."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from rover_sweep.comparison.answer import (
    ABSENT,
    AGREE,
    Agreement,
    Bode,
    Comparison,
    Correction,
    Difference,
    Kind,
    Twin,
    TwinDrive,
)
from rover_sweep.data.codec import encoded, in_json
from rover_sweep.data.recording import MOTIONS
from rover_sweep.data.results import Quantity, ends_words, number
from rover_sweep.diagnosis.result import TimeHistory
from rover_sweep.files.documents import write_file
from rover_sweep.report.charts.chart import ChartPlan
from rover_sweep.report.charts.diagnosis_charts import bode_chart, planned_histories
from rover_sweep.report.diagnosis.tables import mismatch_table
from rover_sweep.report.document import (
    Badge,
    Cell,
    Cells,
    Document,
    Figures,
    Level,
    Part,
    Section,
    Sentence,
    Table,
    Tone,
    items,
    made_words,
    small_print,
    some,
    table_of,
)
from rover_sweep.report.in_html import in_html, write_page
from rover_sweep.report.wording import (
    Provenance,
    channel,
    plain,
    range_words,
    sentence,
    strict_json,
    symbol,
    unit,
)

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
    differ = difference_table(found.differences, "Differences", "page")
    minor = difference_table(found.minor, "Smaller than the normal tolerance")
    undecided = difference_table(found.undecided, "Undecided: the runs agree with either value")
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
            Section("What differs", some(differ, minor, undecided), "differences"),
            Section("Where they differ", some(_places(found)), "where"),
            Section("Each run", some(agreement_table(found.agreement)), "runs"),
            Section("Responses", some(Figures(_responses(found.bode, PREDICTED))), "bode"),
            Section("Time histories", some(Figures(_histories(found.overlays, PREDICTED))), "histories"),
            Section(
                "What could still differ unseen", some(could_differ_table(found)), "hidden", level="page"
            ),
            Section("Remarks", items([sentence(r) for r in found.remarks]), "remarks"),
        ),
        foot=small_print(provenance),
    )


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
            Section("Responses before and after", some(Figures(_responses(found.bode, AGAIN))), "bode"),
            Section(
                "Time histories before and after",
                some(Figures(_histories(found.overlays, AGAIN))),
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
        difference_table((*found.differences, *found.minor, *found.undecided), "Differences"),
        _places(found),
        agreement_table(found.agreement),
    )


def _places(found: Comparison) -> Table:
    return mismatch_table(found.places, "Where simulation and recordings differ", "difference / noise")


def _title(provenance: Provenance, what: str) -> str:
    return f"{provenance.vehicle.name if provenance.vehicle else 'Rover'}: {what}"


def _tone(good: bool) -> Tone:
    return "good" if good else "warn"


# The tables of a comparison.


KINDS: dict[Kind, str] = {
    "instrument": "instrument",
    "number": "number",
    "left out": "left out of the simulation",
    "too much": "only in the simulation",
    "size": "other size",
}
NOISE = "RMS of recorded minus simulated over the noise of both together: 1 is agreement."
BOUNDS = (
    "Recordings minus simulation, at 95 %: these runs do not exclude a difference within this range. "
    "relative: 0.05 is 5 % of the number. matters: smaller is normal tolerance."
)


def difference_table(found: Sequence[Difference], heading: str, level: Level = "brief") -> Table:
    """Each difference with both values; one row per parameter."""
    rows = []
    for d in found:
        for k, (one, two) in enumerate(zip(d.simulation, d.recordings, strict=True)):
            first = ("", "") if k else (Cell(d.name, "strong"), KINDS[d.kind])
            name = "" if one.name == d.name else symbol(one.name)
            simulated = "none" if abs(one.value) >= ABSENT else number(one.value, 3)
            rows.append((*first, name, simulated, Cell(value_text(two), "strong"), unit(two.unit)))
    headings = ("what", "kind", "", "simulation", "recordings (90 %)", "unit")
    return table_of(heading, headings, rows, "", 3, level)


def value_text(v: Quantity) -> str:
    """The value with its interval; "none" for a limit that does not exist."""
    return "none" if abs(v.value) >= ABSENT else f"{number(v.value, 3)} ({ends_words(v.low, v.high)})"


def agreement_table(agreement: Sequence[Agreement]) -> Table:
    """Each run against its simulation, per channel and over all."""
    shown = [c for c in MOTIONS if any(c in a.channels for a in agreement)]
    rows: list[Cells] = [
        (a.run, _role(a.held_out), *(number(a.channels.get(c), 2) for c in shown), _level(a.overall))
        for a in agreement
    ]
    headings = ("run", "", *(channel(c) for c in shown), "all")
    return table_of("Difference of each run", headings, rows, NOISE, 2)


def _level(overall: float | None) -> Cell:
    return Cell(number(overall, 3), "" if overall is None else _tone(overall <= AGREE))


def could_differ_table(found: Comparison) -> Table:
    """How much each quantity could still differ unseen."""
    rows = (
        (name, "" if p == name else symbol(p), range_words(b), number(b.matters, 2), unit(b.unit))
        for name, bounds in found.could_differ.items()
        for p, b in bounds.items()
    )
    headings = ("quantity or effect", "", "could differ by", "matters", "unit")
    return table_of("What could still differ unseen", headings, rows, BOUNDS, 2)


def correction_table(corrections: Sequence[Correction], level: Level) -> Table:
    """Entry, simulation before, recordings, simulation after; with the reasons only on a page."""
    rows = (
        (
            Cell(c.entry.removeprefix("effects."), "strong"),
            c.before or "–",
            c.recordings or "–",
            Cell(c.after or "–", "strong"),
            unit(c.unit),
            *((c.reason,) if level == "page" else ()),
        )
        for c in corrections
    )
    reasons = ("what it is",) if level == "page" else ()
    headings = ("entry", "before", "recorded (90 %)", "after", "unit", *reasons)
    return table_of("What was corrected in the simulated rover", headings, rows, "", 6, level)


def rounds_table(rounds: Sequence[TwinDrive]) -> Table:
    """The difference of each run in each drive of the simulation."""
    levels = [{a.run: a.overall for a in reversed(r.comparison.agreement)} for r in rounds]
    names = dict.fromkeys((a.run, a.held_out) for r in rounds for a in r.comparison.agreement)
    rows: list[Cells] = [(run, _role(held), *(_level(of.get(run)) for of in levels)) for run, held in names]
    drives = (
        f"drive {k + 1}" + (f", {r.simulator}" if r.simulator != "plant" else "")
        for k, r in enumerate(rounds)
    )
    return table_of("Difference of each run, drive by drive", ("run", "", *drives), rows, NOISE, 2)


def _role(held_out: bool) -> str:
    """What a run was for."""
    return "held out" if held_out else "used"


# The pictures of a comparison and of a corrected simulation.


OVERLAY = (
    "Time history with the residual (recorded minus simulated), a close-up, and the residual's spectrum "
    "divided by the noise of both sides. Dashed: twice that noise."
)
BODE = "Responses to the steering. White: where the recording is coherent."


def _histories(overlays: Sequence[TimeHistory], after: str) -> tuple[ChartPlan, ...]:
    """Time histories, not made yet. after: what `after` is, in words."""
    words = f"Before: the simulation; after: {after}. {OVERLAY}"
    return planned_histories(overlays, "overlay", _role(False), words)


def _responses(responses: Sequence[Bode], after: str) -> tuple[ChartPlan, ...]:
    """Responses to the steering, not made yet."""
    if not responses:
        return ()
    first = responses[0]
    caption = f"{first.run}, {_role(first.held_out)}. Before: the simulation; after: {after}. {BODE}"
    return (ChartPlan("bode", caption, partial(bode_chart, tuple(responses))),)


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
    document = strict_json(comparison_document(found, provenance))
    return write_page(directory, "comparison", comparison_report(found, provenance), document).page


def write_twin(found: Twin, directory: Path, provenance: Provenance) -> Path:
    """Write twin.html, variant.toml and twin.json; the path of the page."""
    page = in_html(twin_report(found, provenance))
    document = strict_json(twin_document(found, provenance))
    write_file(directory / "variant.toml", found.variant)
    html = write_file(directory / "twin.html", page)
    write_file(directory / "twin.json", document)
    return html
