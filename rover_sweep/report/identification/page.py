"""The report as one self-contained HTML page: no network, no other file."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rover_sweep.data.recording import Recording
from rover_sweep.identification.acceptance import TITLES, judged_runs, ordered, rejection
from rover_sweep.identification.pipeline import Identification
from rover_sweep.report.charts.shown_chart import ShownChart, by_section
from rover_sweep.report.identification.comparison import (
    Table,
    coherence_table,
    cost_table,
    filters_table,
    inertia_table,
    numbers_table,
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
from rover_sweep.report.wording.shown_units import SI, ShownUnits


def page(
    result: Identification,
    provenance: Provenance,
    pictures: Sequence[ShownChart],
    speed: bool = False,
    units: ShownUnits = SI,
) -> str:
    """The whole page, the charts of each section in the order given. speed: link to speed.html."""
    return (
        environment("report/identification")
        .get_template("page.html.j2")
        .render(
            speed=speed,
            units=units,
            name=provenance.vehicle.name if provenance.vehicle else "",
            result=result,
            provenance=provenance,
            axes=AXES,
            finding=finding(result),
            to_do=to_do(result, provenance),
            main_table=_main_table(result),
            models=[_model(result, name) for name in ordered(result)],
            speeds=" and ".join(f"{group.speed:.2f}" for group in result.groups),
            runs_table=coherence_table(result),
            cost=cost_table(result) if result.models else None,
            verification=verification_tables(result, units),
            inertia=inertia_table(result, provenance),
            handling=handling_table(result, units),
            filters=filters_table(result),
            filters_known=filters_known(result),
            filters_remark=filters_remark(result),
            diagnosis_remark=diagnosis_remark(result),
            recordings=_recordings(result, provenance),
            pictures=by_section(pictures),
        )
    )


def _main_table(result: Identification) -> Table | None:
    """The free parameters of the recommended model with their intervals, below the answer."""
    name = result.recommended
    if not name or rejection(result, name):
        return None
    if numbers := numbers_table(result):
        return numbers
    table = parameter_table(result, name, fixed_rows=False)
    rows = tuple(row[:5] for row in table.rows)
    return Table(f"{TITLES.get(name, name)} model, recommended", table.headings[:5], rows, text_columns=2)


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
