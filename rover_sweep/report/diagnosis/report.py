"""The report of a diagnosis: its document, its charts, and its folder; and the document of a plan."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from rover_sweep.data.recording import grouped_warnings
from rover_sweep.data.results import Progress, number
from rover_sweep.diagnosis.plans.expected_posterior import SimilarPair
from rover_sweep.diagnosis.plans.planner import NAMES, Plan, PlannedRun
from rover_sweep.diagnosis.result import Diagnosis, Finding, LawCurve, Unknown
from rover_sweep.diagnosis.verdict import importance_words
from rover_sweep.files.documents import remove_file, write_file
from rover_sweep.report.charts.chart import ChartPlan
from rover_sweep.report.charts.diagnosis_charts import (
    curves_chart,
    drawable,
    mismatch_chart,
    planned_histories,
)
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
    value_table,
)
from rover_sweep.report.document import (
    ZOOM,
    Badge,
    Cell,
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
from rover_sweep.report.identification.identification_json import AXES
from rover_sweep.report.in_html import in_html, made_charts
from rover_sweep.report.wording import channel, count, hiding_words, plain, sentence, strict_json, unit

WITHOUT_EFFECT = "The whole model, compared with it without this effect"
UNSEEN = "Effects that these runs cannot detect"
TONES: dict[str, Tone] = {
    "none": "good",
    "explained": "good",
    "partly explained": "warn",
    "unexplained": "warn",
    "refused": "bad",
}
NOT_HELD_OUT = (
    "No run was held out, so the improvement is not verified: drive a doublet or one more sweep, and give it "
    "with --hold-out."
)
ABSORBED = "No residual clearly exceeds the noise floor: the nominal parameters absorb the missing effects."
SIZES_OF_PLACES = (
    "Sizes are the residual divided by the noise of the recordings; 1 is the noise floor. Shaded: the band "
    "of the sentence."
)
UNNAMED = {
    "none": "None that these runs can detect.",
    "refused": "The data were refused.",
    "unexplained": "None of the candidates explains it.",
}
MEASURES = (
    "J is the misfit of a frequency response in dB and deg (up to 100 is acceptable), J_rms the rms error "
    "of a prediction in deg/s and ft/s² (1 ft/s² is 0.305 m/s²), TIC its error relative to the motion, 0 "
    f"(perfect) to 1. Axes are {AXES}. In J, 1 dB counts as much as 7.57 deg. Intervals are 90 %."
)


def diagnosis_report(found: Diagnosis, origin: DiagnosisOrigin | None = None) -> Document:
    """A diagnosis as a document; without its origin for a terminal."""
    made = origin or DiagnosisOrigin()
    rover = made.provenance.vehicle.name if made.provenance.vehicle else ""
    checked = f", checked on held-out {', '.join(found.held_out_runs)}" if found.held_out_runs else ""
    runs = count(len(found.runs), "run")
    return Document(
        f"{rover or 'Rover'}: effects that the model leaves out",
        f"The {found.baseline} model against {runs}{checked}, {made_words(made.provenance)}",
        _answer(found),
        (
            _held_out(found),
            _places(found),
            _findings(found),
            Section("The rover as curves", _curves(found), "curves"),
            _unknown(found.unknown, found.sentence),
            _hidden(found),
            _candidates(found),
            _origin(found, made),
        ),
    )


def _answer(found: Diagnosis) -> tuple[Part, ...]:
    hiding = hiding_words(found.cannot_see)
    alike = (
        " ".join(filter(None, (f"{finding_title(f)}.", look_alike_words(f), sentence(next_words(f)))))
        for f in found.findings
        if f.look_alikes or f.next_run
    )
    unknown = sentence(found.unknown.sentence) if found.unknown else ""
    return some(
        Sentence(sentence(found.sentence), "strong", badge=Badge(found.verdict, TONES[found.verdict])),
        *(Sentence(words, level="page") for words in (*alike, unknown)),
        Sentence(f"Could still hide (95 %): {hiding}." if hiding else ""),
    )


def _hidden(found: Diagnosis) -> Section:
    rest = Section("The other effects", some(bound_table(found, noticed=False)), folded="closed")
    parts = some(bound_table(found, noticed=True), rest)
    return Section("What could still hide in these runs", parts, "bounds", level="full")


def _held_out(found: Diagnosis) -> Section:
    tables = some(held_out_table(found.held_out, "On held-out runs"), cost_table(found.held_out))
    missing = "" if found.held_out_runs or found.verdict == "refused" else NOT_HELD_OUT
    figures = Figures(_runs(found, held_out=True))
    hint = Sentence(ZOOM if figures.charts else "", "muted", level="page")
    beside = Section("", tables, beside=True)
    return Section(
        "Before and after, on held-out runs",
        some(hint, beside, Sentence(missing, "warn", level="page"), figures),
        "held-out",
    )


def _places(found: Diagnosis) -> Section:
    heading = "Where simulation and recording differ"
    if not found.mismatch:
        refused = found.verdict == "refused"
        none = Sentence(
            "Nothing was compared." if refused else "No residual exceeds the noise floor.", level="page"
        )
        return Section(heading, (Sentence(ABSORBED) if found.findings else none,), "where")
    charts, words = [], []
    for k, m in enumerate(found.mismatch):
        if drawable(m, found.overlays):
            draw = partial(mismatch_chart, m, found.overlays)
            charts.append(ChartPlan(f"mismatch-{k}", sentence(m.sentence), draw, interactive=False))
        else:
            words.append(Sentence(sentence(m.sentence), level="page"))
    return Section(
        heading,
        some(
            Sentence(SIZES_OF_PLACES, "muted", level="page"),
            Figures(tuple(charts), small=True),
            *words,
            mismatch_table(found.mismatch, heading, "residual / noise"),
        ),
        "where",
    )


def _findings(found: Diagnosis) -> Section:
    none = "" if found.findings else UNNAMED.get(found.verdict, "No effect was named.")
    return Section(
        "Missing effects",
        some(Sentence(none, level="page"), *map(_finding, found.findings), falsified_table(found)),
        "findings",
    )


def _finding(f: Finding) -> Section:
    said = " ".join(filter(None, (sentence(f.sentence), importance_words(f), sentence(f.turn))))
    held = held_out_table(f.held_out, WITHOUT_EFFECT, note=False)
    return Section(
        finding_title(f),
        some(
            Sentence(said),
            Sentence(f.equation, code=True, level="page"),
            value_table(f.parameters, "Parameters"),
            Sentence(look_alike_words(f)),
            Sentence(sentence(next_words(f))),
            Section("", some(held), level="page"),
            Sentence(f"{evidence_words(f)} {certainty_words(f)}".strip(), "muted"),
        ),
        badges=(Badge(f.effect, "muted"),),
    )


def _unknown(u: Unknown | None, headline: str) -> Section:
    """The unexplained part; on a terminal without what the headline says already."""
    heading = "Part that no candidate explains"
    if u is None:
        return Section(heading, (), "unknown")
    clauses = "; ".join(clause for clause in u.sentence.split("; ") if clause not in headline)
    rows = (
        ("where", channel(u.channel)),
        ("size", f"{number(u.residual_over_noise, 2)} × the noise"),
        ("depends on", u.depends_on),
    )
    law = sentence(law_words(u))
    kind = (
        "Chosen by their evidence and fitted in the model" if u.curves else "Fitted to what the model leaves"
    )
    charts = (ChartPlan("unknown-law", LAW, partial(curves_chart, u.curves)),) if u.curves else ()
    return Section(
        heading,
        some(
            Sentence(sentence(u.sentence), level="page"),
            table_of(heading, ("", ""), rows, "", 2),
            Sentence(sentence(clauses), level="terminal"),
            Sentence(law, code=True),
            Sentence(f"{kind}; a description, not a physical law." if law else "", "muted", level="page"),
            Figures(charts),
            *(Sentence(sentence(line)) for line in held_out_lines(u)),
        ),
        "unknown",
    )


def _candidates(found: Diagnosis) -> Section:
    scores = score_table(found)
    none = "" if scores.rows else "No candidate was scored."
    parameters = value_table(found.parameters, "The model, refitted with the effects")
    unseen = table_of(
        UNSEEN, ("effect", "why"), ((u.effect, u.why) for u in found.cannot_see if not u.up_to), "", 2
    )
    fitted = Figures(_runs(found, held_out=False))
    return Section(
        "Candidates and model",
        some(
            Sentence(none, level="page"),
            Section("All candidates", some(scores), folded="closed", level="page"),
            Section("The model with the findings", some(parameters), folded="closed", level="page"),
            Section(UNSEEN, some(unseen), "unseen", "closed"),
            Section("Runs used in the fit", some(fitted), "fitted", "closed", level="page"),
        ),
        "candidates",
    )


def _origin(found: Diagnosis, origin: DiagnosisOrigin) -> Section:
    warnings = grouped_warnings(run for _, run in origin.recordings)
    used = (
        (
            run.name,
            role,
            run.kind,
            "; ".join(f"{file}, sha256 {digest}" for file, digest in run.sources),
            f"{run.span[1] - run.span[0]:.1f}",
        )
        for role, run in origin.recordings
    )
    headings = ("run", "used as", "kind", "file", "s")
    return Section(
        "Remarks and origin",
        some(
            *items([sentence(remark) for remark in found.remarks], "muted"),
            *items([sentence(words) for words in warnings], "muted", "page"),
            table_of("Recordings", headings, used, "", 4, "page"),
            Sentence(MEASURES, level="page"),
            Sentence(f"{found.seconds:.1f} s.", "muted", level="page"),
            *(replace(words, level="page") for words in small_print(origin.provenance)),
        ),
        "origin",
    )


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


BENT = 0.05  # share of a curve's height from which a terminal draws its bend


def _runs(found: Diagnosis, held_out: bool) -> tuple[ChartPlan, ...]:
    """The runs measured and simulated."""
    drawn = [o for o in found.overlays if o.t.size > 1 and o.held_out == held_out]
    name = "held-out" if held_out else "fitted"
    return planned_histories(drawn, name, "used in the fit", OVERLAY, bool(found.findings))


def _curves(found: Diagnosis) -> tuple[Part, ...]:
    bent = [curve for curve in found.curves if curve.bend >= BENT]
    shown: tuple[tuple[Sequence[LawCurve], Level], ...] = ((found.curves, "page"), (bent, "terminal"))
    return tuple(
        Figures((ChartPlan("curves", CURVES, partial(curves_chart, curves)),), level=level)
        for curves, level in shown
        if curves
    )


# Folder of a diagnosis: diagnosis.html, diagnosis.json, and variant.toml for the simulated rover.


@dataclass(frozen=True)
class DiagnosisFiles:
    """Paths of the written files."""

    document: Path
    page: Path
    variant: Path | None = None
    """The model as a simulated rover; None if the data were refused, or for a lumped model."""


def write_diagnosis(
    found: Diagnosis, directory: Path, origin: DiagnosisOrigin, progress: Progress | None = None
) -> DiagnosisFiles:
    """Write all files, diagnosis.json last: a folder with diagnosis.json is complete and of one diagnosis.

    All content is computed before the first file is changed. progress is called with the current step
    and the share done, 0..1. UsageError if the directory is not writable.
    """
    from rover_sweep.report.export.plant_variant import variant_text

    document = strict_json(diagnosis_document(found, origin))
    shown = diagnosis_report(found, origin)
    page = in_html(shown, made_charts(shown, progress))
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


def plan_report(plan: Plan) -> Document:
    """Sentences, runs, detectable sizes, limits and proposed runs."""
    first, *rest = plan.sentences or ("",)
    unseen = ((u.effect, u.why) for u in plan.cannot_see)
    added = "Additional runs to drive" if plan.runs else "Runs to drive"
    return Document(
        "Plan",
        "",
        some(Sentence(sentence(first), "strong"), *(Sentence(sentence(text)) for text in rest)),
        (
            Section(
                "",
                some(
                    run_table(plan.runs, "These runs"),
                    size_table(plan),
                    pair_table(plan.look_alikes, "Effects that these runs cannot separate"),
                    table_of(UNSEEN, ("effect", "why"), unseen, text_columns=2),
                    run_table(plan.proposal, added),
                    *(Sentence(sentence(text)) for text in plan.settles if plan.proposal),
                    pair_table(plan.proposed_look_alikes, "Effects still not separated with them"),
                    *(Sentence(sentence(text)) for text in plan.notes),
                ),
            ),
        ),
    )


def run_table(runs: Sequence[PlannedRun], heading: str) -> Table:
    """Kind, amplitude, speed, heading and number of each run."""
    rows = (
        (
            NAMES[run.kind] + (f", {run.name}" if run.name else ""),
            f"{run.amplitude_us:g}" + (f" about {run.bias_us:+g}" if run.bias_us else ""),
            f"{run.speed:g}",
            "any" if run.heading is None else f"{run.heading:.0f}",
            str(run.repeat),
        )
        for run in runs
    )
    return table_of(heading, ("", "amplitude, us", "speed, m/s", "heading, deg", "times"), rows)


def size_table(plan: Plan) -> Table:
    """Detectable size of each effect, in the plan's order; marked where it exceeds the size that matters."""
    rows = []
    for effect, size in plan.detectable.items():
        too_large = size.size is None or (size.material is not None and size.size > size.material)
        detectable = Cell(number(size.size, 2), "warn" if too_large else "")
        rows.append((effect, size.parameter, detectable, number(size.material, 2), unit(size.unit)))
    return table_of("Detectable sizes", ("effect", "", "detectable", "matters", "unit"), rows, SIZES, 2)


def pair_table(pairs: Sequence[SimilarPair], heading: str) -> Table:
    """Pairs of effects with the expected probability of the second where the first is true."""
    rows = ((p.first, p.second, f"{100 * p.probability:.0f} %") for p in pairs)
    return table_of(heading, ("true", "explains it as well", "probability"), rows, text_columns=2)
