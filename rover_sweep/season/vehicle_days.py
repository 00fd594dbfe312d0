"""Which logs are of one vehicle, and its days.

A log belongs to the vehicle whose file is named after it or lists its board. Otherwise to the board in the
log; two boards are one vehicle where they follow each other in a folder that holds no third one at the same
time: the board was swapped. A log without a board belongs to its folder and MAVLink id.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.season.measured_log import MeasuredLog


@dataclass(frozen=True, eq=False)
class VehicleDay:
    """All fitted logs of a vehicle on one day, with the sum of their likelihoods (k, k), (k,)."""

    day: str
    logs: tuple[MeasuredLog, ...]
    information: Array
    linear: Array

    @property
    def parameters(self) -> Mapping[str, float]:
        """Those of the last log of the day."""
        return self.logs[-1].parameters

    @property
    def board(self) -> str:
        """That of the last log of the day, "" if not logged."""
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
    """{(folder, board): name of the vehicle} of folders in which boards follow each other."""
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
    names = _usual_names(logs)
    days: dict[str, list[MeasuredLog]] = defaultdict(list)
    for log in logs:
        if log.fit is not None and log.fit.names == names and log.sha256 not in seen:
            seen.add(log.sha256)
            days[log.day].append(log)
    return tuple(_day(day, tuple(days[day])) for day in sorted(days))


def _usual_names(logs: Sequence[MeasuredLog]) -> tuple[str, ...]:
    every = [log.fit.names for log in logs if log.fit is not None]
    return max(every, key=lambda names: (every.count(names), names)) if every else ()


def _day(day: str, logs: tuple[MeasuredLog, ...]) -> VehicleDay:
    fits = [log.fit for log in logs if log.fit is not None]
    return VehicleDay(
        day,
        logs,
        np.sum([fit.information for fit in fits], axis=0),
        np.sum([fit.linear for fit in fits], axis=0),
    )
