"""Makes a season from the logs of a fleet: vehicles, their quantities day by day, and drifts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import date
from math import exp

import numpy as np

from rover_sweep.comparison.common_model import of_the_rover
from rover_sweep.comparison.differences import Comparable, quantities
from rover_sweep.data.geometry import Geometry
from rover_sweep.data.recording import Array
from rover_sweep.data.results import NORMAL_90
from rover_sweep.diagnosis.simulation.candidates import Coordinate
from rover_sweep.season.changes import (
    FEWEST,
    Days,
    Explained,
    FoundChange,
    VehicleTests,
    changes_of,
    drift_sentence,
    explained,
    season_sentence,
)
from rover_sweep.season.season_result import (
    DayValue,
    Drift,
    MeasuredLog,
    ParameterChange,
    Season,
    TrackedQuantity,
    VehicleDay,
    VehicleSeason,
    by_vehicle,
    days_of,
    event_drifts,
    parameter_changes,
    season_model,
    within,
)

# Found changes and daily values in the quantities' own units, with intervals and causes.


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
        q, b = tests.quantities[c.quantity], tests.directions[:, c.quantity]
        # without this change, and with it, on the last day that has all of it
        at = int(np.flatnonzero(c.shape.course == c.shape.course.max())[-1])
        without = last.means[at] - b * c.size
        before, unit, meaning = _value(q, coordinates, without)
        after, _, _ = _value(q, coordinates, without + b * c.size)
        ends = [c.size + side * NORMAL_90 * c.sd for side in (-1.0, 1.0)]
        if q.relative:
            is_log = any(part.startswith("ln_") for part in q.parts[0])
            low, high = (exp(e) for e in ends) if is_log else (1.0 + e for e in ends)
        else:
            low, high = sorted(_value(q, coordinates, without + b * e)[0] - before for e in ends)
        earliest, latest = days[c.possible[0]], days[c.possible[-1]]
        gradual = c.shape.kind == "gradual"
        first = days[max(c.possible[0] - (0 if gradual else 1), 0)]
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
            parameters=within(parameters, first, days[-1] if gradual else latest),
        )
        sentence = drift_sentence(drift, days[max(c.shape.at - 1, 0)], days[-1])
        event = next((e for e in events if drift.kind == "step" and earliest <= e.day <= latest), None)
        cause = "" if event is None else f"{event.quantity} was changed"
        if event is not None and event.kind == "board":
            cause = "the board was swapped"
        found.append(replace(drift, cause=cause, sentence=f"{sentence}, when {cause}" if cause else sentence))
    return tuple(sorted(found, key=lambda d: (d.day, d.kind not in ("board", "parameter"), d.quantity)))


def _value(q: Comparable, coordinates: Sequence[Coordinate], x: Array) -> tuple[float, str, str]:
    """(value, unit, meaning) of a quantity at coordinates (k,) over their scales."""
    # not clipped to the bounds: an interval may pass them
    at = {c.name: float(v * c.scale) for c, v in zip(coordinates, x, strict=True)}
    return next(iter(q.report(at).values()))


def tracked(
    days: Sequence[str], coordinates: Sequence[Coordinate], tests: VehicleTests, last: Explained
) -> tuple[TrackedQuantity, ...]:
    """Each quantity on each day, with the season's values of the other coordinates."""
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
                _value(q, coordinates, last.means[d] + b * (away[d] + side * NORMAL_90 * sd[d]))[0]
                for side in (0.0, -1.0, 1.0)
            ]
            rows.append(DayValue(day, values[0], min(values[1:]), max(values[1:]), fitted))
        usual = float(np.sqrt(b @ (last.scatter * b)) / max(b @ b, 1e-300))
        scatter = abs(_value(q, coordinates, last.means[-1] + usual * b)[0] - rows[-1].fitted)
        out.append(TrackedQuantity(q.name, unit, meaning, scatter, tuple(rows)))
    return tuple(out)


QUANTITIES = (
    "C",
    "Cf",
    "Cr",
    "Izz",
    "k_phi",
    "b_phi",
    "rad_per_us",
    "servo_lag",
    "servo_delay",
    "steering_trim",
    "steering_backlash",
    "cg_to_front_axle",
    "imu_x",
    "imu_z",
    "bias_ay",
    "ay_lag",
    "p_lag",
    "velocity_lag",
    "heading",
    "speed_scale",
)
USUAL = 0.1  # of a coordinate's scale: scatter from day to day where too few vehicles show it
ENOUGH = 3  # vehicles that show what is usual
PASSES = 2
WEAK = 1e-6  # 1/variance of a coordinate without a prior


@dataclass(frozen=True, eq=False)
class _Vehicle:
    """A vehicle with enough days, as the tests need it."""

    name: str
    days: tuple[VehicleDay, ...]
    coordinates: tuple[Coordinate, ...]
    tests: VehicleTests


def season(logs: Sequence[MeasuredLog], rovers: Mapping[str, Geometry]) -> Season:
    """The season of these logs. rovers: {name of a vehicle file: its geometry}.

    The result depends on the set of logs only, not on their order.
    """
    grouped = by_vehicle(logs)
    days = {name: days_of(own) for name, own in grouped.items()}
    tested = [_vehicle(name, days[name], rovers) for name in grouped if len(days[name]) >= FEWEST]
    tests = sum(v.tests.count for v in tested)
    changes: dict[str, tuple[tuple[FoundChange, ...], Explained]] = {
        v.name: ((), explained(v.tests.days, ())) for v in tested
    }
    for _ in range(PASSES):
        tested = _with_usual(tested, {name: found.scatter for name, (_, found) in changes.items()})
        changes = {v.name: changes_of(v.tests, tests) for v in tested}
    known = {v.name: v for v in tested}
    vehicles = tuple(
        _shown(name, grouped[name], days[name], known.get(name), changes.get(name)) for name in grouped
    )
    no_day = "the day is not known: no GPS time in the log and no date in its name"
    unused = (log for log in logs if log.fit is None or not log.day)
    refused = tuple(sorted((log.source, log.refused or no_day) for log in unused))
    found = Season("", vehicles, refused, len(logs), tests)
    return replace(found, sentence=season_sentence(found))


def _vehicle(name: str, days: tuple[VehicleDay, ...], rovers: Mapping[str, Geometry]) -> _Vehicle:
    log = days[-1].logs[-1]
    model = season_model(rovers[log.vehicle_file])
    coordinates = of_the_rover(model.free)
    offered = {q.name: q for q in quantities(model, coordinates)}
    chosen: tuple[Comparable, ...] = tuple(offered[n] for n in QUANTITIES if n in offered)
    scale = np.array([c.scale for c in coordinates])
    prior = np.array([(c.scale / c.prior) ** 2 if c.prior else WEAK for c in coordinates])
    numbers = Days(
        np.array([d.information for d in days]),
        np.array([d.linear for d in days]),
        prior,
        np.array([c.start for c in coordinates]) / scale,
        np.full(scale.size, USUAL**2),
    )
    times: Array = np.array([date.fromisoformat(d.day).toordinal() for d in days], float)
    directions = np.column_stack([q.columns(coordinates)[:, 0] for q in chosen])
    return _Vehicle(name, days, coordinates, VehicleTests(numbers, times, chosen, directions))


def _with_usual(vehicles: Sequence[_Vehicle], scatters: Mapping[str, Array]) -> list[_Vehicle]:
    """The vehicles with the median scatter of all of the same model, if there are enough."""
    out = []
    for v in vehicles:
        names = [c.name for c in v.coordinates]
        alike = [scatters[w.name] for w in vehicles if [c.name for c in w.coordinates] == names]
        if len(alike) >= ENOUGH:
            days = replace(v.tests.days, usual=np.median(alike, axis=0))
            v = replace(v, tests=replace(v.tests, days=days))
        out.append(v)
    return out


def _shown(
    name: str,
    logs: Sequence[MeasuredLog],
    days: Sequence[VehicleDay],
    vehicle: _Vehicle | None,
    found: tuple[tuple[FoundChange, ...], Explained] | None,
) -> VehicleSeason:
    by_day = {d.day: tuple(log.source for log in d.logs) for d in days}
    boards: dict[str, str] = {}
    for d in days:
        if d.board:
            boards.setdefault(d.board, d.day)
    changed = parameter_changes(days)
    events = event_drifts(name, days, changed)
    if vehicle is None or found is None:
        remark = f"{len(days)} day(s) with a fit; drifts are searched from {FEWEST} days on"
        return VehicleSeason(name, by_day, boards, (), tuple(events), changed, (remark,))
    drifts = drifts_with_events(
        name, [d.day for d in days], vehicle.coordinates, vehicle.tests, *found, events, changed
    )
    shown = tracked([d.day for d in days], vehicle.coordinates, vehicle.tests, found[1])
    unused = sum(log.fit is not None for log in logs) - sum(len(d.logs) for d in days)
    remarks = (f"{unused} log(s) left out: copies of others, or without roll",) if unused else ()
    return VehicleSeason(name, by_day, boards, shown, drifts, changed, remarks)
