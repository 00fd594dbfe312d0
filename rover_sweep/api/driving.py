"""Any driving in Python: from logs to what they show of the steering, without sweeps or a vehicle file."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from os import fspath
from pathlib import Path
from typing import Any

from rover_sweep.api.read import Location
from rover_sweep.driving.answer import DrivingAnswer, answer_from
from rover_sweep.errors import DataRefused, UsageError
from rover_sweep.files.replaced import remove_file, write_file
from rover_sweep.logs.log import Log
from rover_sweep.logs.read import read_logs
from rover_sweep.report.driving import driving_document, driving_report
from rover_sweep.report.in_html import in_html

DRIVING_FILE = "driving.json"
WHEELBASES = 0.02, 20.0  # m


@dataclass(frozen=True)
class DrivingFiles:
    """Paths of the written files."""

    directory: Path
    document: Path
    page: Path


@dataclass(frozen=True, eq=False, repr=False)
class DrivingIdentification(DrivingAnswer):
    """The result of `identify_driving`. It prints as a table."""

    sources: tuple[str, ...] = ()

    def report(self, directory: Location) -> DrivingFiles:
        """Writes driving.html and driving.json into a folder, which is created if missing.

        >>> driven.report("driving").page.name
        'driving.html'
        """
        folder = Path(directory)
        html = in_html(driving_report(self, ", ".join(self.sources)))
        text = json.dumps(driving_document(self), indent=2, allow_nan=False, ensure_ascii=False)
        remove_file(folder / DRIVING_FILE)
        folder.mkdir(parents=True, exist_ok=True)
        page = write_file(folder / "driving.html", html)
        return DrivingFiles(folder, write_file(folder / DRIVING_FILE, text + "\n"), page)


def identify_driving(
    *sources: Location,
    columns: Mapping[str, Any] | str | None = None,
    wheelbase: float | None = None,
    system: int | None = None,
) -> DrivingIdentification:
    """What any driving of one rover shows of its steering: a mission, or driving about by hand.

    sources: .BIN, .tlog or .csv (with `columns`, a column map), or "log.BIN+log.tlog". wheelbase [m], if it
    was measured: gives K_us in deg/g and the steering ratio. system: MAVLink id of the vehicle in a .tlog.

    `numbers` by name, as far as the driving shows them: `curvature` of the path for each 100 us and
    `least_radius` (steering in us), or `wheelbase_seen` (in rad); `straight`, the output that drives straight
    ahead; `delay`, `lag` and their sum `response_time`; `understeer`, K_us over the wheelbase, or
    `understeer_gradient`; `characteristic_speed` or `critical_speed`; `bend`, how much less the rover turns
    in hard turns. A poor result raises nothing: its level and reasons say so. UsageError for a missing file,
    DataRefused for a log that cannot be read or has no steering, speed or yaw rate.

    >>> driven = rs.identify_driving("run1.BIN")
    >>> driven.level, driven.numbers["straight"].unit
    ('good', 'us')
    """
    if not sources:
        raise UsageError("there is no log; give a .BIN, .tlog or .csv")
    low, high = WHEELBASES
    known = isinstance(wheelbase, float | int) and not isinstance(wheelbase, bool)
    if wheelbase is not None and not (known and low <= wheelbase <= high):
        raise UsageError(f"the wheelbase is {wheelbase!r}; give metres, {low:g} to {high:g}")
    names = [fspath(source) for source in sources]
    logs = list(_logs(names, columns, system))
    files = [source for log in {log.sources: log for log in logs}.values() for source in log.sources]
    if len(set(names)) < len(names) or len({sha for _, sha in files}) < len(files):
        raise UsageError("the same log is given twice, which would make its numbers look more certain")
    found = answer_from(logs, wheelbase)
    return DrivingIdentification(
        **{f.name: getattr(found, f.name) for f in fields(found)}, sources=tuple(Path(n).name for n in names)
    )


def _logs(names: Sequence[str], columns: Mapping[str, Any] | str | None, system: int | None) -> Iterator[Log]:
    """The logs that have all that is needed; DataRefused without any."""
    lacking = ""
    found = False
    for name in names:
        for log in read_logs(name, column_map=columns, system=system):
            missing = [words for key, words in (("speed", "speed"), ("r", "yaw rate")) if not _has(log, key)]
            missing += [] if log.steering and log.steering[0].t.size > 1 else ["steering output"]
            if missing:
                lacking = lacking or f"{log.name} has no {' and no '.join(missing)}"
                continue
            found = True
            yield log
    if not found:
        raise DataRefused(f"{lacking}; steering, speed and yaw rate are needed to see how the rover steers")


def _has(log: Log, key: str) -> bool:
    return key in log.signals and log.signals[key].t.size > 1
