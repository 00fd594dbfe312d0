"""Found changes and daily values in the quantities' own units, with intervals and causes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import exp

import numpy as np

from rover_sweep.comparison.quantities import Comparable
from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.simulation.nominal import Coordinate
from rover_sweep.season.changes import FoundChange, VehicleTests
from rover_sweep.season.drift_words import drift_sentence
from rover_sweep.season.firmware_events import within
from rover_sweep.season.scatter import Explained
from rover_sweep.season.season_result import DayValue, Drift, ParameterChange, TrackedQuantity

HALF_90 = 1.645  # half width of a 90 % interval in standard deviations


def drifts_with_events(
    name: str,
    days: Sequence[str],
    coordinates: Sequence[Coordinate],
    tests: VehicleTests,
    changes: Sequence[FoundChange],
    last: Explained,
    events: Sequence[Drift],
    parameters: Sequence[ParameterChange],
) -> tuple[Drift, ...]:
    """All drifts of a vehicle by day, events first. parameters: all that changed."""
    found = [*events]
    for c in changes:
        drift = _drift(name, days, coordinates, tests, c, last, parameters)
        found.append(_with_cause(drift, events))
    return tuple(sorted(found, key=lambda d: (d.day, d.kind not in ("board", "parameter"), d.quantity)))


def _drift(
    name: str,
    days: Sequence[str],
    coordinates: Sequence[Coordinate],
    tests: VehicleTests,
    c: FoundChange,
    last: Explained,
    parameters: Sequence[ParameterChange],
) -> Drift:
    q, b = tests.quantities[c.quantity], tests.directions[:, c.quantity]
    # without this change, and with it, on the last day that has all of it
    at = int(np.flatnonzero(c.shape.course == c.shape.course.max())[-1])
    without = last.means[at] - b * c.size
    before, unit, meaning = _value(q, coordinates, without)
    after, _, _ = _value(q, coordinates, without + b * c.size)
    ends = [c.size + side * HALF_90 * c.sd for side in (-1.0, 1.0)]
    if q.relative:
        low, high = (exp(e) for e in ends) if _is_log(q) else (1.0 + e for e in ends)
    else:
        low, high = sorted(_value(q, coordinates, without + b * e)[0] - before for e in ends)
    earliest, latest = days[c.possible[0]], days[c.possible[-1]]
    gradual = c.shape.kind == "gradual"
    first = days[max(c.possible[0] - (0 if gradual else 1), 0)]
    end = days[-1] if gradual else latest
    drift = Drift(
        name,
        c.shape.kind,
        q.name,
        meaning,
        unit,
        days[c.shape.at],
        earliest,
        latest,
        before,
        after,
        float(low),
        float(high),
        q.relative,
        c.ratio,
        bool(abs(c.size) >= q.matters),
        tuple(tests.quantities[k].name for k in c.look_alikes),
        parameters=within(parameters, first, end),
    )
    return _worded(drift, days)


def _worded(drift: Drift, days: Sequence[str]) -> Drift:
    place = days.index(drift.day)
    previous = days[place - 1] if place else drift.day
    return replace(drift, sentence=drift_sentence(drift, previous, days[-1]))


def _with_cause(drift: Drift, events: Sequence[Drift]) -> Drift:
    """A step at the time of an event has the event as its cause."""
    at = [e for e in events if drift.kind == "step" and drift.earliest <= e.day <= drift.latest]
    if not at:
        return drift
    cause = "the board was swapped" if at[0].kind == "board" else f"{at[0].quantity} was changed"
    return replace(drift, cause=cause, sentence=f"{drift.sentence}, when {cause}")


def _is_log(q: Comparable) -> bool:
    return any(name.startswith("ln_") for name in q.parts[0])


def _value(q: Comparable, coordinates: Sequence[Coordinate], x: Array) -> tuple[float, str, str]:
    """(value, unit, meaning) of a quantity at coordinates (k,) over their scales."""
    # not clipped to the bounds: an interval may pass them
    at = {c.name: float(v * c.scale) for c, v in zip(coordinates, x, strict=True)}
    return next(iter(q.report(at).values()))


def tracked(
    days: Sequence[str], coordinates: Sequence[Coordinate], tests: VehicleTests, last: Explained
) -> tuple[TrackedQuantity, ...]:
    """Each quantity on each day, the other coordinates as the season shows them on that day."""
    out = []
    for k, q in enumerate(tests.quantities):
        b = tests.directions[:, k]
        information = np.maximum(np.einsum("i,dij,j->d", b, last.weight, b), 1e-300)
        away, sd = (last.score @ b) / information, information**-0.5
        rows = []
        unit = meaning = ""
        for d, day in enumerate(days):
            fitted, unit, meaning = _value(q, coordinates, last.means[d])
            values = [
                _value(q, coordinates, last.means[d] + b * (away[d] + side * HALF_90 * sd[d]))[0]
                for side in (0.0, -1.0, 1.0)
            ]
            rows.append(DayValue(day, values[0], min(values[1:]), max(values[1:]), fitted))
        usual = float(np.sqrt(b @ (last.scatter * b)) / max(b @ b, 1e-300))
        scatter = abs(_value(q, coordinates, last.means[-1] + usual * b)[0] - rows[-1].fitted)
        out.append(TrackedQuantity(q.name, unit, meaning, scatter, tuple(rows)))
    return tuple(out)
