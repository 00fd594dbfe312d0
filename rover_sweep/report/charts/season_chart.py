"""The quantities of a vehicle over the days of a season."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime

import numpy as np

from rover_sweep.report.charts.chart import Chart, Curve, Panel, Spread, Stack
from rover_sweep.report.charts.colours import DATA, MARK
from rover_sweep.season.season_result import Drift, TrackedQuantity

DAY = 86400.0  # s


def season_chart(quantities: Sequence[TrackedQuantity], drifts: Sequence[Drift]) -> Chart:
    """A small chart of each quantity with its 90 % interval, the changed ones first, changes shaded."""
    ordered, changed = changed_first(quantities, drifts)
    return Chart(tuple(_course(q, changed.get(q.name)) for q in ordered if q.days), columns=3)


def changed_first(
    quantities: Sequence[TrackedQuantity], drifts: Sequence[Drift]
) -> tuple[list[TrackedQuantity], dict[str, Drift]]:
    """(quantities, those with a change first; {quantity: its change})."""
    changed = {d.quantity: d for d in drifts if d.kind in ("gradual", "step")}
    return sorted(quantities, key=lambda q: q.name not in changed), changed


def _course(q: TrackedQuantity, drift: Drift | None) -> Stack:
    t = np.array([_seconds(d.day) for d in q.days])
    value, low, high, fitted = (
        np.array([getattr(d, name) for d in q.days]) for name in ("value", "low", "high", "fitted")
    )
    course = Curve(
        "course", fitted, MARK if drift else "#777777", step=drift is not None and drift.kind == "step"
    )
    shown = f", {q.unit}" if q.unit and "vehicle file" not in q.unit else ""
    panel = Panel(
        q.name,
        t,
        (course, Curve("value", value, DATA, dots=True)),
        (Spread("90 % interval", low, high),),
        height=130,
    )
    shades = (
        () if drift is None else ((_seconds(drift.earliest) - DAY, _seconds(drift.latest) + DAY, "#FBE9C6"),)
    )
    title = f"{q.name}{shown}" + (": changed" if drift else "")
    return Stack(title, "", (panel,), (float(t[0]) - DAY, float(t[-1]) + DAY), "date", shades)


def _seconds(day: str) -> float:
    return datetime.fromisoformat(day).replace(tzinfo=UTC).timestamp()
