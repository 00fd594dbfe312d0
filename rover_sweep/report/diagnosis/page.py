"""A diagnosis as one self-contained HTML page: no network, no other file."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rover_sweep.data.recording import grouped_warnings
from rover_sweep.diagnosis.result import Diagnosis, Finding
from rover_sweep.diagnosis.verdict import importance_words
from rover_sweep.report.charts.shown_chart import ShownChart, by_section
from rover_sweep.report.diagnosis.origin import DiagnosisOrigin
from rover_sweep.report.diagnosis.pictures import mismatch_section
from rover_sweep.report.diagnosis.tables import (
    bound_table,
    certainty_words,
    cost_table,
    evidence_words,
    falsified_table,
    finding_title,
    held_out_table,
    look_alike_words,
    mismatch_table,
    next_words,
    unseen_table,
    value_table,
)
from rover_sweep.report.diagnosis.terminal import held_out_lines, law_words
from rover_sweep.report.identification.identification_json import AXES
from rover_sweep.report.templates import environment
from rover_sweep.report.wording.bound_words import hiding_words
from rover_sweep.report.wording.effect_names import channel, sentence

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
