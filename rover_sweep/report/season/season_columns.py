"""A season as tables of columns for other programs: CSV, and Parquet with pyarrow."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from typing import Any

from rover_sweep.errors import missing_extra
from rover_sweep.season.measured_log import MeasuredLog
from rover_sweep.season.season_result import Season

Columns = Mapping[str, Sequence[Any]]


def season_columns(season: Season, logs: Sequence[MeasuredLog]) -> dict[str, Columns]:
    """{table: {column: values}} of quantities, drifts, parameters and logs; None where there is no value."""
    values = [
        (v.name, d.day, q.name, q.unit, d.value, d.low, d.high, d.fitted) for v, q, d in _values(season)
    ]
    drifts = [
        (
            d.vehicle,
            d.kind,
            d.quantity,
            d.unit,
            d.day,
            d.earliest,
            d.latest,
            d.before,
            d.after,
            d.low,
            d.high,
            d.relative,
            d.ratio,
            d.matters,
            d.cause,
            d.sentence,
        )
        for v in season.vehicles
        for d in v.drifts
    ]
    changed = [
        (v.name, p.name, p.day_before, p.day_after, p.before, p.after)
        for v in season.vehicles
        for p in v.parameters
    ]
    vehicle_of = {s: v.name for v in season.vehicles for day in v.logs.values() for s in day}
    each = [
        (
            log.source,
            vehicle_of.get(log.source, ""),
            log.day,
            log.day_from,
            log.board,
            log.system,
            log.firmware,
            log.sha256,
            log.fit.variance if log.fit else None,
            log.refused,
        )
        for log in sorted(logs, key=lambda log: log.source)
    ]
    return {
        "quantities": _table("vehicle day quantity unit value low high fitted", values),
        "drifts": _table(
            "vehicle kind quantity unit day earliest latest before after low high relative ratio matters "
            "cause sentence",
            drifts,
        ),
        "parameters": _table("vehicle parameter day_before day_after before after", changed),
        "logs": _table(
            "log vehicle day day_from board system firmware sha256 residual_over_noise refused", each
        ),
    }


def _values(season: Season) -> Any:
    return ((v, q, d) for v in season.vehicles for q in v.quantities for d in q.days)


def _table(names: str, rows: Sequence[Sequence[Any]]) -> Columns:
    return {name: [row[k] for row in rows] for k, name in enumerate(names.split())}


def as_csv(columns: Columns) -> str:
    """The columns with a heading; numbers exact, nothing for None."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(columns)
    for row in zip(*columns.values(), strict=True):
        writer.writerow(["" if x is None else repr(x) if isinstance(x, float) else x for x in row])
    return out.getvalue()


def as_parquet(columns: Columns) -> bytes:
    """The columns as a Parquet file; UsageError without pyarrow."""
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError:
        raise missing_extra("--parquet needs pyarrow", "fleet") from None
    sink = pyarrow.BufferOutputStream()
    pyarrow.parquet.write_table(pyarrow.table(dict(columns)), sink)
    return bytes(sink.getvalue())
