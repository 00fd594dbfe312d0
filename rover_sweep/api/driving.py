"""Any driving in Python: from logs to numbers of the steering, without sweeps or a vehicle file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from os import fspath
from pathlib import Path
from typing import Any

import numpy as np

from rover_sweep.api.read import Location, left_out_note
from rover_sweep.data.recording import Signal, origin_remark
from rover_sweep.data.results import ShortTable
from rover_sweep.data.vehicle_file import load
from rover_sweep.data.vehicle_geometry import geometry_of
from rover_sweep.driving.answer import DrivingAnswer, answer_from
from rover_sweep.driving.consistency import with_one_clock, with_slope
from rover_sweep.driving.stretches import OTHER_GYRO_HZ
from rover_sweep.errors import DataRefused, UsageError
from rover_sweep.logs.log import GYRO_FACTORY_HZ, Log
from rover_sweep.logs.read import READ, read_logs, usable_log
from rover_sweep.logs.readers.tables import is_table_file
from rover_sweep.report.driving import driving_document, driving_report
from rover_sweep.report.in_html import PageFiles, write_page
from rover_sweep.report.wording import strict_json

WHEELBASES = 0.02, 20.0  # m


@dataclass(frozen=True, eq=False, repr=False)
class DrivingIdentification(DrivingAnswer):
    """The result of `identify_driving`. It prints as a table.

    read: channels that contradict each other, what is damaged or missing, and how files of other systems were
    read, such as the columns that were found without a map, and whether their steering was measured, or may
    have been. foreign: whether
    a log is of another system.
    """

    sources: tuple[str, ...] = ()
    read: tuple[str, ...] = ()
    foreign: bool = False

    def table(self) -> ShortTable:
        """The numbers with their intervals, what stays unknown, and how files of other systems were read."""
        whole = super().table()
        return replace(whole, notes=(*whole.notes, *self.read))

    def report(self, directory: Location) -> PageFiles:
        """Writes driving.html and driving.json into a folder, which is created if missing.

        >>> driven.report("driving").page.name
        'driving.html'
        """
        page = driving_report(self, ", ".join(self.sources), self.read)
        return write_page(Path(directory), "driving", page, strict_json(driving_document(self)))


def identify_driving(
    *sources: Location,
    columns: Mapping[str, Any] | str | None = None,
    wheelbase: float | None = None,
    vehicle: Location | None = None,
    system: int | None = None,
) -> DrivingIdentification:
    """Identifies the steering of one rover from any driving: a mission, or driving by hand.

    sources: .BIN, .tlog, "log.BIN+log.tlog", or files of other systems (.csv, .parquet, .mat, .ulg, .bag,
    .mcap), whose columns are found if no column map `columns` is given; `read` then lists them.
    wheelbase [m], if it was measured: gives K_us in deg/g and the steering ratio. vehicle: a vehicle file
    instead, for these and, with its mass, yaw inertia and centre of gravity, the tyres. system: MAVLink id of
    the vehicle in a .tlog.

    `numbers` by name, as far as the driving shows them: `curvature` of the path for each 100 us and
    `least_radius` (steering in us), `wheelbase_seen` (in rad) or `full_radius` (in -1 to 1); `straight`, the
    output that drives straight ahead; `delay`, `lag` and their sum `response_time`; `understeer`, K_us over
    the wheelbase, or `understeer_gradient`; `characteristic_speed` or `critical_speed`; `bend`, how much less
    the rover turns in hard turns; `steering_curve`, and the curvature of each side (`curvature_left`), where
    they differ from a straight line; `front_stiffness` and `rear_stiffness` with a vehicle file. Logs that do
    not agree give no number; `each` has their own answers. A poor result raises nothing: its level and
    reasons say so.
    UsageError for a missing file, DataRefused for a log that cannot be read or has no steering, speed or
    yaw rate.

    >>> driven = rs.identify_driving("run1.BIN")
    >>> driven.level, driven.numbers["straight"].unit
    ('good', 'us')
    """
    if not sources:
        raise UsageError(f"there is no log; give {READ}")
    low, high = WHEELBASES
    known = isinstance(wheelbase, float | int) and not isinstance(wheelbase, bool)
    if wheelbase is not None and not (known and low <= wheelbase <= high):
        raise UsageError(f"the wheelbase is {wheelbase!r}; give metres, {low:g} to {high:g}")
    names = [fspath(source) for source in sources]
    rover = None if vehicle is None else geometry_of(load(vehicle))
    usable, refused = _logs(names, columns, system)
    logs = tuple(with_slope(log) if _is_foreign(log) else log for log in usable)
    logs = with_one_clock(logs) if all(map(_is_foreign, logs)) else logs
    found = answer_from(logs, wheelbase, rover)
    foreign = [log for log in logs if _is_foreign(log)]
    decided = [one.text for one in found.driving.contradictions if one.decided]
    warnings = [n.text for log in logs for n in log.notes if n.level == "warning" or log in foreign]
    notes = [
        *_of_coarse_steering(found.driving.coarse),
        *(left_out_note(refusal).text for refusal in refused),
        *decided,
        *(words for words in warnings if words not in found.reasons),
    ]
    notes.append(origin_remark({log.name: log.steering[0] for log in foreign if log.steering}))
    notes += [OTHER_GYRO] if foreign and found.driving.low_pass_unknown else []
    return DrivingIdentification(
        **{f.name: getattr(found, f.name) for f in fields(found)},
        sources=tuple(Path(n).name for n in names),
        read=tuple(dict.fromkeys(filter(None, notes))),
        foreign=bool(foreign),
    )


OTHER_GYRO = (
    "The file does not say how its gyro is filtered: the response time allows for any low-pass from "
    f"{OTHER_GYRO_HZ:g} Hz ({GYRO_FACTORY_HZ:g} Hz for a PWM in us) to none. If you know it, give "
    "filters = {gyro_hz = ..} in a column map"
)


def _of_coarse_steering(steering: Signal | None) -> Iterator[str]:
    """That the steering was logged seldom, what holds all the same, and what to change. None: it was not."""
    if steering is None:
        return
    why = f"The steering ({steering.source}) was logged at {steering.rate:.0f} Hz only"
    holds = "curvature and straight hold, and the intervals allow for its unknown way between samples"
    change = "record a .tlog with SERVO_OUTPUT_RAW at 50 Hz, or log with the applet"
    if steering.source.startswith("RCOU"):
        change = f"no bit of LOG_BITMASK logs it faster: {change}"
    yield f"{why}: {holds}. For quick motion {change}"


def _is_foreign(log: Log) -> bool:
    """True for a file of another system, of which it is not evident how it was read."""
    return any(is_table_file(Path(name)) for name, _ in log.sources)


def _logs(
    names: Sequence[str], columns: Mapping[str, Any] | str | None, system: int | None
) -> tuple[tuple[Log, ...], tuple[DataRefused, ...]]:
    """(the logs that can be used, the refusal of each source without any).

    DataRefused where no source has one, UsageError for a file that is given twice.
    """
    usable: list[Log] = []
    refused: list[DataRefused] = []
    known: set[str] = set()
    for name in names:
        try:
            with np.errstate(invalid="ignore", over="ignore"):  # damaged numbers are removed next
                logs = read_logs(name, column_map=columns, system=system)
        except DataRefused as refusal:
            refused.append(refusal)
            continue
        files = {sha for log in logs for _, sha in log.sources}
        if files & known:
            raise UsageError("the same log is given twice, which would make its numbers look more certain")
        known |= files
        own, refusals = _usable(logs)
        usable += own
        refused += refusals[:1] if not own else []
    if not usable:
        raise refused[0]
    return tuple(usable), tuple(refused)


def _usable(logs: Sequence[Log]) -> tuple[list[Log], list[DataRefused]]:
    """The starts of a vehicle in one source that can be used, and the refusals of the others."""
    usable: list[Log] = []
    refusals: list[DataRefused] = []
    for log in logs:
        try:
            usable.append(usable_log(log, steering_wheel=True))
        except DataRefused as refusal:
            refusals.append(refusal)
    return usable, refusals
