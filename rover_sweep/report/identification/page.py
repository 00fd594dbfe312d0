"""The report as one self-contained HTML page: no network, no other file."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from rover_sweep.data.recording import Recording
from rover_sweep.identification.acceptance import TITLES, judged_runs, ordered, rejection
from rover_sweep.identification.pipeline import Identification
from rover_sweep.report.identification.comparison import (
    Table,
    coherence_table,
    cost_table,
    filters_table,
    inertia_table,
    parameter_table,
    poles_table,
    reduction_table,
    variants_table,
    verification_tables,
)
from rover_sweep.report.identification.handling_table import handling_table
from rover_sweep.report.identification.identification_json import AXES
from rover_sweep.report.identification.remarks import (
    diagnosis_remark,
    filters_known,
    filters_remark,
    finding,
    to_do,
)
from rover_sweep.report.templates import environment
from rover_sweep.report.wording.number_format import SHORT_NAMES, number
from rover_sweep.report.wording.provenance import Provenance

if TYPE_CHECKING:
    from rover_sweep.report.identification.pictures import Picture

Drawn = Sequence[tuple["Picture", bytes]]


def page(result: Identification, provenance: Provenance, pictures: Drawn) -> str:
    """The whole page. pictures: each with its PNG, embedded in the order given."""
    return (
        environment("report/identification")
        .get_template("page.html.j2")
        .render(
            name=provenance.vehicle.name if provenance.vehicle else "",
            result=result,
            provenance=provenance,
            axes=AXES,
            finding=finding(result),
            to_do=to_do(result, provenance),
            models=[_model(result, name) for name in ordered(result)],
            speeds=" and ".join(f"{group.speed:.2f}" for group in result.groups),
            runs_table=coherence_table(result),
            cost=cost_table(result) if result.models else None,
            verification=verification_tables(result),
            inertia=inertia_table(result, provenance),
            handling=handling_table(result),
            filters=filters_table(result),
            filters_known=filters_known(result),
            filters_remark=filters_remark(result),
            diagnosis_remark=diagnosis_remark(result),
            recordings=_recordings(result, provenance),
            pictures=by_section(pictures),
        )
    )


def _model(result: Identification, name: str) -> dict[str, Any]:
    model, rejected = result.models[name], rejection(result, name)
    tables: list[Table | None] = [
        parameter_table(result, name),
        reduction_table(model),
        variants_table(result, name),
        None if rejected or name == "kinematic" else poles_table(model),
    ]
    return {
        "name": name,
        "title": TITLES.get(name, name),
        "reference": model.fit.structure.reference,
        "verdict": model.verdict,
        "recommended": name == result.recommended,
        "tables": [table for table in tables if table],
    }


def by_section(pictures: Drawn) -> dict[str, list[dict[str, str]]]:
    """{section: [{source, caption}]}, the pictures as data URLs, for `figures` of page_parts.html.j2."""
    sections: dict[str, list[dict[str, str]]] = {}
    for picture, data in pictures:
        source = "data:image/png;base64," + base64.b64encode(data).decode("ascii")
        sections.setdefault(picture.section, []).append({"source": source, "caption": picture.caption})
    return sections


def _recordings(result: Identification, provenance: Provenance) -> list[dict[str, Any]]:
    fits = [_recording(run, "identification", v.sentence if v else "") for run, v in judged_runs(result)]
    return fits + [_recording(run, "verification", "") for run in provenance.verify_runs]


def _recording(run: Recording, role: str, sentence: str) -> dict[str, Any]:
    start, end = run.span
    return {
        "run": run,
        "role": role,
        "sentence": sentence,
        "duration": end - start,
        "channels": [_channel(run, name) for name in run.channels],
    }


def _channel(run: Recording, name: str) -> tuple[str, ...]:
    signal = run.channels[name]
    rate = number(run.manoeuvre(name).rate, 3)
    return SHORT_NAMES.get(name, name), signal.source or "–", signal.unit, rate, _filter(run, name)


def _filter(run: Recording, channel: str) -> str:
    known = run.filters.get(channel)
    return f"{number(known.cutoff_hz, 3)} Hz ({known.source})" if known else "–"
