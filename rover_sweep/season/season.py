"""From the logs of a fleet to a season: the vehicles, their quantities day by day, and what drifted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import date

import numpy as np

from rover_sweep.comparison.quantities import Comparable, quantities
from rover_sweep.data.geometry import Geometry
from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.simulation.nominal import Coordinate
from rover_sweep.season.changes import FEWEST, FoundChange, VehicleTests, changes_of
from rover_sweep.season.drift_words import season_sentence
from rover_sweep.season.firmware_events import event_drifts, parameter_changes
from rover_sweep.season.fitted_log import season_model
from rover_sweep.season.found_drifts import drifts_with_events, tracked
from rover_sweep.season.measured_log import MeasuredLog
from rover_sweep.season.scatter import Days, Explained, explained, with_usual
from rover_sweep.season.season_result import Season, VehicleSeason
from rover_sweep.season.vehicle_days import VehicleDay, by_vehicle, days_of

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
    refused = tuple(sorted((log.source, _why(log)) for log in logs if log.fit is None or not log.day))
    found = Season("", vehicles, refused, len(logs), tests)
    return replace(found, sentence=season_sentence(found))


def _why(log: MeasuredLog) -> str:
    return log.refused or "the day is not known: no GPS time in the log and no date in its name"


def _vehicle(name: str, days: tuple[VehicleDay, ...], rovers: Mapping[str, Geometry]) -> _Vehicle:
    log = days[-1].logs[-1]
    model = season_model(rovers[log.vehicle_file])
    coordinates = model.free
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
    """The vehicles with the median scatter of those of the same model, where there are enough."""
    out = []
    for v in vehicles:
        names = [c.name for c in v.coordinates]
        alike = [scatters[w.name] for w in vehicles if [c.name for c in w.coordinates] == names]
        if len(alike) >= ENOUGH:
            days = with_usual(v.tests.days, np.median(alike, axis=0))
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
