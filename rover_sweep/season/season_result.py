"""A season as frozen values; `rover_sweep.report.season_report` writes it."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from threadpoolctl import threadpool_limits

from rover_sweep.comparison.common_model import side_of
from rover_sweep.data.codec import decoded, encoded
from rover_sweep.data.geometry import Geometry, Tolerances
from rover_sweep.data.recording import Array, Recording
from rover_sweep.diagnosis.simulation.candidates import Model
from rover_sweep.diagnosis.simulation.experiment import experiment, in_order
from rover_sweep.spectra.side_by_side import one_thread

DriftKind = Literal["gradual", "step", "day", "board", "parameter"]
"""gradual: grows from a day on. step: another value from a day on. day: on one day only, which is no drift.
board: another autopilot. parameter: one of the firmware that changes the recorded signals or the steering."""


@dataclass(frozen=True)
class ParameterChange:
    """A parameter of the firmware that differs between two days of a vehicle. before, after: its values."""

    name: str
    day_before: str
    day_after: str
    before: float
    after: float


@dataclass(frozen=True)
class Drift:
    """Something that changed on a vehicle.

    quantity: its name. day: first day after a step, or last day before a gradual change begins; earliest,
    latest: its 95 % interval (days of logs). before, after: the quantity (gradual: at the end of the season),
    None for a board. low, high: 90 % interval of after minus before, or of after/before where
    `relative`. ratio: change over its standard deviation. matters: False if within tolerance.
    cause: simultaneous event that explains it, "" for none. parameters: changes at that time.
    """

    vehicle: str
    kind: DriftKind
    quantity: str
    meaning: str
    unit: str
    day: str
    earliest: str
    latest: str
    before: float | None = None
    after: float | None = None
    low: float | None = None
    high: float | None = None
    relative: bool = False
    ratio: float | None = None
    matters: bool = True
    look_alikes: tuple[str, ...] = ()
    cause: str = ""
    parameters: tuple[ParameterChange, ...] = ()
    sentence: str = ""

    @property
    def counts(self) -> bool:
        """False for a drift within tolerance, on one day only, or caused by another change."""
        return self.matters and not self.cause and self.kind != "day"


@dataclass(frozen=True)
class DayValue:
    """A quantity on one day, with a 90 % interval of its difference from the vehicle's other days.

    The interval includes the usual scatter from day to day, but not errors common to all days. fitted: value
    of the season's fitted course on that day.
    """

    day: str
    value: float
    low: float
    high: float
    fitted: float


@dataclass(frozen=True)
class TrackedQuantity:
    """A quantity of a vehicle over its days. scatter: usual standard deviation from day to day."""

    name: str
    unit: str
    meaning: str
    scatter: float
    days: tuple[DayValue, ...]


@dataclass(frozen=True)
class VehicleSeason:
    """A vehicle. logs: sources of each day, {day: sources}. boards: {board: first day}."""

    name: str
    logs: Mapping[str, tuple[str, ...]]
    boards: Mapping[str, str]
    quantities: tuple[TrackedQuantity, ...] = ()
    drifts: tuple[Drift, ...] = ()
    parameters: tuple[ParameterChange, ...] = ()
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True)
class Season:
    """A fleet's season. refused: (source, why) of every log without a fit. tests: number made."""

    sentence: str
    vehicles: tuple[VehicleSeason, ...]
    refused: tuple[tuple[str, str], ...]
    logs: int
    tests: int

    @property
    def drifts(self) -> tuple[Drift, ...]:
        """Drifts of all vehicles that matter and have no other cause."""
        return tuple(d for v in self.vehicles for d in v.drifts if d.counts)


# The runs of one log fitted with the model of a season, as a likelihood of the model's coordinates.
#
# A day determines some combinations of coordinates well and others hardly: lag, inertia and steering scale,
# for one, replace each other in a short run. The estimates of single days therefore scatter together. The
# quadratic likelihood of the day at its fit, without the priors,
#
#     log L(x) = -1/2 x^T D x + h^T x,   D = J^T J/v,   h = D x_fit + J^T r/v
#
# keeps all of it, so that the days of a vehicle can share every coordinate that did not change. J: Jacobian
# of the rows by the coordinates over their scales, r: residual rows, v: their variance. The priors count
# once for a vehicle, not once a day.


EFFECTS = ("steering_backlash",)
SEASON = Tolerances(
    lag=0.25,
    delay=0.25,
    early=0.03,
    ratio=1.0,
    bias_ay=1.5,
    trim=0.06,
    scale=0.03,
    speed=0.01,
    cg=0.025,
    h=0.10,
    roll_inertia=0.15,
    imu_x=0.05,
    imu_z=0.05,
    sensor_lag=0.006,
    velocity_gain=0.10,
    velocity_lag=0.30,
    heading=0.03,
    together=0.20,
    bend=1.5,
)
"""Wide for numbers that change, else near the vehicle file, so that the fits of all days are close."""


@dataclass(frozen=True, eq=False)
class FittedLog:
    """The likelihood of the k coordinates over their scales, see the module.

    names: of the coordinates. values (k,): the fit, with the priors. information (k, k): D. linear (k,): h.
    variance: of a whitened row, 1 at the noise floor. runs: names of the fitted runs.
    """

    names: tuple[str, ...]
    values: Array
    information: Array
    linear: Array
    variance: float
    runs: tuple[str, ...]


def season_model(rover: Geometry) -> Model:
    """The model of a season: the roll-yaw model with play, or the bicycle if the file has no roll."""
    rolls = bool(rover.sprung_mass and rover.h and rover.roll_inertia)
    return Model("roll-yaw" if rolls else "bicycle", rover, SEASON, EFFECTS)


@threadpool_limits.wrap(limits=1, user_api="blas")
def fitted_log(runs: Sequence[Recording], rover: Geometry) -> FittedLog:
    """The runs, with `delta`, fitted together, on one thread. rover: of the vehicle file."""
    with one_thread():
        side = side_of(in_order([experiment(run) for run in runs]), season_model(rover), {}, EFFECTS)
    fitted, variance = side.fitted, side.fitted.overdispersion
    names = tuple(c.name for c in side.coordinates)
    own = np.array([c.name in names for c in fitted.free])
    others, error = fitted.jacobian[:, own], fitted.jacobian[:, ~own]
    # What the day's error explains says nothing of the rover.
    outside = others - error @ np.linalg.lstsq(error, others, rcond=None)[0]
    information = outside.T @ outside / variance
    linear = information @ side.values + outside.T @ fitted.rows / variance
    return FittedLog(
        names, side.values, np.asarray(information), linear, variance, tuple(r.name for r in runs)
    )


# One log of a season: when, on which board, with which parameters, and its fit or why there is none.


FORMAT = 1  # of the saved values; another one is measured again


@dataclass(frozen=True, eq=False)
class MeasuredLog:
    """The values of one log.

    source: path or URL as given. sha256: of its contents. day: ISO date (UTC), "" if not known; day_from:
    "GPS", "telemetry", "file name" or "file time". board: name and id of the autopilot's board, "" if not
    logged. system: MAVLink id, "" if not known. vehicle: its name, if a vehicle file is named after it, else
    "". vehicle_file: name of the file whose numbers were used.
    refused: the sentence of a log that cannot be used, "" for one that was fitted.
    """

    source: str
    sha256: str = ""
    day: str = ""
    day_from: str = ""
    board: str = ""
    system: str = ""
    firmware: str = ""
    vehicle: str = ""
    vehicle_file: str = ""
    parameters: Mapping[str, float] = field(default_factory=dict)
    fit: FittedLog | None = None
    refused: str = ""


def as_document(log: MeasuredLog) -> dict[str, Any]:
    """The log in plain JSON types; `from_document` restores every number exactly."""
    return {"format": "rover-sweep measured log", "format_version": FORMAT, **encoded(log)}


def from_document(document: Mapping[str, Any]) -> MeasuredLog:
    """The log of `as_document`; KeyError or ValueError for anything else."""
    if document["format_version"] != FORMAT:
        raise ValueError(f"format {document['format_version']} instead of {FORMAT}")
    return decoded(document, MeasuredLog)


# Which logs are of one vehicle, and its days.
#
# A log belongs to the vehicle whose file is named after it or lists its board. Otherwise to the board in the
# log; two boards are one vehicle where they follow each other in a folder that holds no third one at the
# same time: the board was swapped. A log without a board belongs to its folder and MAVLink id.


@dataclass(frozen=True, eq=False)
class VehicleDay:
    """All fitted logs of a vehicle on one day, with the sum of their likelihoods (k, k), (k,)."""

    day: str
    logs: tuple[MeasuredLog, ...]
    information: Array
    linear: Array

    @property
    def parameters(self) -> Mapping[str, float]:
        """Parameters in the day's last log."""
        return self.logs[-1].parameters

    @property
    def board(self) -> str:
        """Board in the day's last log, "" if not logged."""
        return self.logs[-1].board


def by_vehicle(logs: Sequence[MeasuredLog]) -> dict[str, tuple[MeasuredLog, ...]]:
    """{vehicle: its logs, by day and source}, of logs with a day; the names in order."""
    ordered = sorted((log for log in logs if log.day), key=lambda log: (log.day, log.source))
    swapped = _swapped(ordered)
    found: dict[str, list[MeasuredLog]] = defaultdict(list)
    for log in ordered:
        own = swapped.get((folder_of(log.source), log.board), log.board)
        system = f" system {log.system}" if log.system else ""
        found[log.vehicle or own or f"{folder_of(log.source)}{system}"].append(log)
    return {name: tuple(found[name]) for name in sorted(found)}


def folder_of(source: str) -> str:
    """Name of the folder of a path or URL, "" for none."""
    return source.replace("\\", "/").rpartition("/")[0].rpartition("/")[2]


def _swapped(logs: Sequence[MeasuredLog]) -> dict[tuple[str, str], str]:
    """{(folder, board): name of the vehicle} of folders in which a board replaced another."""
    spans: dict[str, dict[str, tuple[str, str]]] = defaultdict(dict)
    for log in logs:
        if log.board and not log.vehicle:
            boards = spans[folder_of(log.source)]
            first, _ = boards.get(log.board, (log.day, log.day))
            boards[log.board] = first, log.day
    out: dict[tuple[str, str], str] = {}
    for folder, boards in spans.items():
        ordered = sorted(boards.values())
        chain = all(a[1] < b[0] for a, b in zip(ordered, ordered[1:], strict=False))
        if len(boards) > 1 and chain and folder:
            out |= {(folder, board): folder for board in boards}
    return out


def days_of(logs: Sequence[MeasuredLog]) -> tuple[VehicleDay, ...]:
    """The days with a fit of the vehicle's usual model; logs with the same contents count once."""
    seen: set[str] = set()
    every = [log.fit.names for log in logs if log.fit is not None]
    names = max(every, key=lambda names: (every.count(names), names), default=())
    days: dict[str, list[MeasuredLog]] = defaultdict(list)
    for log in logs:
        if log.fit is not None and log.fit.names == names and log.sha256 not in seen:
            seen.add(log.sha256)
            days[log.day].append(log)
    out = []
    for day in sorted(days):
        fits = [log.fit for log in days[day] if log.fit is not None]
        information = np.sum([fit.information for fit in fits], axis=0)
        linear = np.sum([fit.linear for fit in fits], axis=0)
        out.append(VehicleDay(day, tuple(days[day]), information, linear))
    return tuple(out)


# Events that the logs themselves show: parameters of the firmware that changed, and another board.


# Statistics and calibrations that the firmware itself changes; settings of the manoeuvre
_BY_ITSELF = re.compile(
    r"STAT_|SWP_|BARO\d?_|INS_.*(OFFS|_ID|CALTEMP|SCAL)|INS\d_|COMPASS_|GND_|FORMAT_VERSION|SYSID_SW|RC\d+_(MIN|MAX|TRIM)|"
    r"AHRS_GPS|MIS_TOTAL|FENCE_TOTAL|RALLY_TOTAL|LOG_|BRD_SERIAL"
)
_ACTING = re.compile(
    r"INS_(GYRO_FILTER|ACCEL_FILTER|HNTC|NOTCH|RAW_LOG|FAST|POS)|SERVO\d+_(TRIM|MIN|MAX|REVERSED|FUNCTION|RATE)|"
    r"SERVO_RATE|AHRS_(ORIENTATION|TRIM)|SCHED_LOOP_RATE|ATC_|RCMAP_|FRAME_|MOT_"
)
"""Parameters that change the recorded signals, or the way from command to wheel."""
SAME = 1e-6  # relative; parameters are single precision


def parameter_changes(days: Sequence[VehicleDay]) -> tuple[ParameterChange, ...]:
    """Parameters that differ from the day before, in the order of days and names."""
    changes = []
    for one, two in pairwise(days):
        for name in sorted(one.parameters.keys() & two.parameters.keys()):
            a, b = one.parameters[name], two.parameters[name]
            if abs(a - b) > SAME * max(abs(a), abs(b)) and not _BY_ITSELF.match(name):
                changes.append(ParameterChange(name, one.day, two.day, a, b))
    return tuple(changes)


def within(changes: Sequence[ParameterChange], first: str, last: str) -> tuple[ParameterChange, ...]:
    """The changes that can have happened from the day `first` to the day `last`."""
    return tuple(c for c in changes if c.day_before <= last and c.day_after >= first)


def event_drifts(vehicle: str, days: Sequence[VehicleDay], changes: Sequence[ParameterChange]) -> list[Drift]:
    """Each board swap, and each changed parameter that acts on signals or steering."""
    out = []
    for one, two in pairwise(days):
        at, day = tuple(c for c in changes if c.day_after == two.day), (two.day,) * 3
        between = f"between {one.day} and {two.day}"
        if one.board and two.board and one.board != two.board:
            words = f"{vehicle}: the board was swapped {between} ({one.board} before, {two.board} after)"
            meaning = "autopilot that wrote the log"
            out.append(Drift(vehicle, "board", "board", meaning, "", *day, parameters=at, sentence=words))
        for c in (c for c in at if _ACTING.match(c.name)):
            words = f"{vehicle}: {c.name} was changed from {c.before:g} to {c.after:g} {between}"
            meaning, values = "parameter of the firmware", (c.before, c.after)
            out.append(
                Drift(
                    vehicle, "parameter", c.name, meaning, "", *day, *values, parameters=(c,), sentence=words
                )
            )
    return out
