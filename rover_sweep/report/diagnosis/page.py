"""A diagnosis as one self-contained HTML page: no network, no other file."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from rover_sweep.data.recording import grouped_warnings
from rover_sweep.data.results import number
from rover_sweep.diagnosis.plans.planner import NAMES, DetectableSize, Plan, PlannedRun, SimilarPair
from rover_sweep.diagnosis.result import Diagnosis, Finding, TimeHistory
from rover_sweep.diagnosis.verdict import importance_words
from rover_sweep.files.replaced import remove_file, write_file
from rover_sweep.report.charts.chart import ChartPlan
from rover_sweep.report.charts.diagnosis_charts import curves_chart, drawable, mismatch_chart, overlay_chart
from rover_sweep.report.charts.static_svg import ShownChart, by_section, shown_charts
from rover_sweep.report.diagnosis.diagnosis_json import DiagnosisOrigin, diagnosis_document
from rover_sweep.report.diagnosis.tables import (
    bound_table,
    certainty_words,
    cost_table,
    evidence_words,
    falsified_table,
    finding_title,
    held_out_lines,
    held_out_table,
    law_words,
    look_alike_words,
    mismatch_table,
    next_words,
    score_table,
    unseen_table,
    value_table,
)
from rover_sweep.report.identification.comparison import Cell, Table
from rover_sweep.report.identification.identification_json import AXES
from rover_sweep.report.identification.terminal import Sentence, rich_table
from rover_sweep.report.templates import environment
from rover_sweep.report.wording import channel, hiding_words, plain, sentence, strict_json, unit

# The pictures of a diagnosis and their captions.


OVERLAY = (
    "Time history with the residual (measured minus simulated), a close-up, and the spectrum of the residual "
    "divided by the noise floor. Dashed: twice the noise."
)
CURVES = (
    "The rover's laws at rest, with their 90 % bands, over the range that the runs visited. Dashed: the "
    "linear law, of a tyre its tangent at 0."
)
LAW = (
    "The laws that were fitted in the model for the part without a name, with their 90 % bands. A constant "
    "cannot be separated from trim and biases, so a curve is relative to its value at 0 or to its mean. Of a "
    "resonance the gain is drawn."
)


def planned(found: Diagnosis) -> tuple[ChartPlan, ...]:
    """All charts of a diagnosis, not made yet."""
    return (*_mismatches(found), *_runs(found), *_curves(found))


def mismatch_section(index: int) -> str:
    """Section of the page for the picture of this mismatch."""
    return f"mismatch-{index}"


def _mismatches(found: Diagnosis) -> Iterator[ChartPlan]:
    for k, m in enumerate(found.mismatch):
        if drawable(m, found.overlays):
            name = mismatch_section(k)
            draw = partial(mismatch_chart, m, found.overlays)
            yield ChartPlan(name, name, sentence(m.sentence), draw, interactive=False)


def _runs(found: Diagnosis) -> Iterator[ChartPlan]:
    by_run: dict[tuple[str, bool], list[TimeHistory]] = {}
    for o in (o for o in found.overlays if o.t.size > 1):
        by_run.setdefault((o.run, o.held_out), []).append(o)
    changed = bool(found.findings)
    for k, ((run, held_out), channels) in enumerate(by_run.items()):
        role = "held out" if held_out else "used in the fit"
        section, draw = "held-out" if held_out else "fitted", partial(overlay_chart, tuple(channels), changed)
        yield ChartPlan(f"overlay-{k}", section, f"{run}, {role}. {OVERLAY}", draw)


def _curves(found: Diagnosis) -> Iterator[ChartPlan]:
    if found.curves:
        yield ChartPlan("curves", "curves", CURVES, partial(curves_chart, found.curves))
    if found.unknown and found.unknown.curves:
        yield ChartPlan("unknown-law", "unknown", LAW, partial(curves_chart, found.unknown.curves))


# Folder of a diagnosis: diagnosis.html, diagnosis.json, and variant.toml for the simulated rover.


@dataclass(frozen=True)
class DiagnosisFiles:
    """Paths of the written files."""

    document: Path
    page: Path
    variant: Path | None = None
    """The model as a simulated rover; None if the data were refused, or for a lumped model."""


def write_diagnosis(
    found: Diagnosis,
    directory: Path,
    origin: DiagnosisOrigin,
    progress: Callable[[float, str], None] | None = None,
) -> DiagnosisFiles:
    """Write all files, diagnosis.json last: a folder with diagnosis.json is complete and of one diagnosis.

    All content is computed before the first file is changed. progress is called with the share done, 0..1,
    and the current step. UsageError if the directory is not writable.
    """
    from rover_sweep.report.export.plant_variant import variant_text

    document = strict_json(diagnosis_document(found, origin))
    drawn = shown_charts(planned(found), progress)
    page = diagnosis_page(found, origin, drawn)
    text = variant_text(found.model) if found.model and not found.model.lumped else None
    for name in ("diagnosis.json", "variant.toml"):
        remove_file(directory / name)
    html = write_file(directory / "diagnosis.html", page)
    variant = write_file(directory / "variant.toml", text) if text else None
    return DiagnosisFiles(write_file(directory / "diagnosis.json", document), html, variant)


# A plan as tables and as JSON.


FORMAT_VERSION = 2
SIZES = (
    "detectable: size from which a diagnosis is expected to name the effect with 80 %. "
    "matters: smaller is normal tolerance."
)


def plan_document(plan: Plan) -> dict[str, Any]:
    """The plan in plain JSON types; units in the keys or in "units"."""
    return plain(
        {
            "format": "rover-sweep plan",
            "format_version": FORMAT_VERSION,
            "sentences": plan.sentences,
            "runs": [asdict(run) for run in plan.runs],
            "detectable": {effect: asdict(size) for effect, size in plan.detectable.items()},
            "not_told_apart": [asdict(pair) for pair in plan.look_alikes],
            "cannot_see": [{"effect": u.effect, "why": u.why} for u in plan.cannot_see],
            "proposal": [asdict(run) for run in plan.proposal],
            "settles": plan.settles,
            "notes": plan.notes,
            "not_told_apart_with_the_proposal": [asdict(pair) for pair in plan.proposed_look_alikes],
            "units": "amplitude_us, bias_us: us; speed: m/s, 0 on blocks; heading: deg clockwise from north",
        }
    )


def plan_summary(plan: Plan) -> Group:
    """Sentences, runs, detectable sizes, limits and proposed runs, for `Console.print`."""
    parts: list[RenderableType] = []
    for k, part in enumerate(_parts(plan)):
        parts += [Text(""), part] if k else [part]
    return Group(*parts)


def _parts(plan: Plan) -> Iterator[RenderableType]:
    if plan.sentences:
        first, *rest = plan.sentences
        yield Group(Sentence(sentence(first), "bold"), *(Sentence(sentence(text)) for text in rest))
    if plan.runs:
        yield rich_table(run_table(plan.runs, "These runs"))
    if plan.detectable:
        yield rich_table(size_table(plan))
    if plan.look_alikes:
        yield rich_table(pair_table(plan.look_alikes, "Effects that these runs cannot separate"))
    if plan.cannot_see:
        rows = tuple((Cell(u.effect), Cell(u.why)) for u in plan.cannot_see)
        yield rich_table(
            Table("Effects that these runs cannot detect", ("effect", "why"), rows, text_columns=2)
        )
    if plan.proposal:
        yield rich_table(
            run_table(plan.proposal, "Additional runs to drive" if plan.runs else "Runs to drive")
        )
        if plan.settles:
            yield Group(*(Sentence(sentence(text)) for text in plan.settles))
        if plan.proposed_look_alikes:
            yield rich_table(pair_table(plan.proposed_look_alikes, "Effects still not separated with them"))
    if plan.notes:
        yield Group(*(Sentence(sentence(text)) for text in plan.notes))


def run_table(runs: Sequence[PlannedRun], heading: str) -> Table:
    """Kind, amplitude, speed, heading and number of each run."""
    rows = tuple(_run(run) for run in runs)
    return Table(heading, ("", "amplitude, us", "speed, m/s", "heading, deg", "times"), rows)


def _run(run: PlannedRun) -> tuple[Cell, ...]:
    kind = NAMES[run.kind] + (f", {run.name}" if run.name else "")
    amplitude = f"{run.amplitude_us:g}" + (f" about {run.bias_us:+g}" if run.bias_us else "")
    speed = f"{run.speed:g}" if run.speed else "0"
    heading = "any" if run.heading is None else f"{run.heading:.0f}"
    return Cell(kind), Cell(amplitude), Cell(speed), Cell(heading), Cell(str(run.repeat))


def size_table(plan: Plan) -> Table:
    """Detectable size of each effect, in the plan's order; marked where it exceeds the size that matters."""
    rows = tuple(_size(effect, size) for effect, size in plan.detectable.items())
    return Table("Detectable sizes", ("effect", "", "detectable", "matters", "unit"), rows, SIZES, 2)


def _size(effect: str, size: DetectableSize) -> tuple[Cell, ...]:
    too_large = size.size is None or (size.material is not None and size.size > size.material)
    return (
        Cell(effect),
        Cell(size.parameter),
        Cell(number(size.size, 2), "warn" if too_large else ""),
        Cell(number(size.material, 2)),
        Cell(unit(size.unit)),
    )


def pair_table(pairs: Sequence[SimilarPair], heading: str) -> Table:
    """Pairs of effects with the expected probability of the second where the first is true."""
    rows = tuple((Cell(p.first), Cell(p.second), Cell(f"{100 * p.probability:.0f} %")) for p in pairs)
    return Table(heading, ("true", "explains it as well", "probability"), rows, text_columns=2)


WITHOUT_EFFECT = "The whole model, compared with it without this effect"
TONES = {
    "none": "good",
    "explained": "good",
    "partly explained": "warn",
    "unexplained": "warn",
    "refused": "bad",
}


def diagnosis_page(found: Diagnosis, origin: DiagnosisOrigin, pictures: Sequence[ShownChart]) -> str:
    """The whole page. pictures: shown in the order given."""
    warnings = grouped_warnings(run for _, run in origin.recordings)
    return (
        environment("report/diagnosis")
        .get_template("diagnosis.html.j2")
        .render(
            found=found,
            origin=origin,
            provenance=origin.provenance,
            name=origin.provenance.vehicle.name if origin.provenance.vehicle else "",
            answer=sentence(found.sentence),
            tone=TONES[found.verdict],
            axes=AXES,
            mismatches=[(sentence(m.sentence), mismatch_section(k)) for k, m in enumerate(found.mismatch)],
            mismatch_table=mismatch_table(found),
            findings=[_finding(f) for f in found.findings],
            held_out=held_out_table(found.held_out, "All findings, compared with the baseline"),
            costs=cost_table(found.held_out),
            falsified=falsified_table(found),
            law=sentence(law_words(found.unknown)) if found.unknown else "",
            law_lines=[sentence(line) for line in held_out_lines(found.unknown)] if found.unknown else [],
            unknown=sentence(found.unknown.sentence) if found.unknown else "",
            unknown_channel=channel(found.unknown.channel) if found.unknown else "",
            scores=score_table(found),
            unseen=unseen_table(found),
            bounds=bound_table(found),
            hiding=hiding_words(found.cannot_see),
            parameters=value_table(found.parameters, "The model, refitted with the effects")
            if found.parameters
            else None,
            remarks=[sentence(remark) for remark in (*found.remarks, *warnings) if remark],
            pictures=by_section(pictures),
        )
    )


def _finding(f: Finding) -> dict[str, Any]:
    return {
        "effect": f.effect,
        "title": finding_title(f),
        "sentence": " ".join(filter(None, (sentence(f.sentence), importance_words(f), sentence(f.turn)))),
        "equation": f.equation,
        "parameters": value_table(f.parameters, "Parameters") if f.parameters else None,
        "look_alikes": look_alike_words(f),
        "evidence": f"{evidence_words(f)} {certainty_words(f)}".strip(),
        "next_run": sentence(next_words(f)),
        "held_out": held_out_table(f.held_out, WITHOUT_EFFECT, note=False) if f.held_out else None,
    }
