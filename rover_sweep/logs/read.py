"""From the name of a recording to the runs in it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rover_sweep.errors import UsageError
from rover_sweep.identify.recording import Recording
from rover_sweep.logs.judge import judged, refuse_useless
from rover_sweep.logs.log import Log
from rover_sweep.logs.runs import find_runs


def read_runs(
    source: str,
    *,
    column_map: Mapping[str, Any] | str | None = None,
    filters: Mapping[str, float] | None = None,
) -> tuple[Recording, ...]:
    """All runs in a recording, in SI units and ISO axes, judged.

    source: path of a .BIN, .tlog or .csv, or "log.BIN+log.tlog" (both of one drive, put together on
    the vehicle's clock). column_map: for a .csv, see `rover_sweep.logs.csv`. filters: {"gyro_hz",
    "accel_hz"} [Hz, 0 = off] in place of the recorded INS_GYRO_FILTER and INS_ACCEL_FILTER.
    Raises UsageError for a source that cannot be opened, DataRefused for one that cannot be used.
    """
    runs = []
    for log in read_logs(source, column_map=column_map, filters=filters):
        refuse_useless(log)
        runs += [judged(run, log) for run in find_runs(log)]
    return tuple(runs)


def read_logs(
    source: str,
    *,
    column_map: Mapping[str, Any] | str | None = None,
    filters: Mapping[str, float] | None = None,
) -> tuple[Log, ...]:
    """The logs in a source: one, or several where the vehicle restarted or a .csv joins trials."""
    path = _existing(source)
    from rover_sweep.logs.flash_channels import read_dataflash

    return (read_dataflash(path, filters),)


def _existing(name: str) -> Path:
    path = Path(name).expanduser()
    if not path.is_file():
        raise UsageError(f"{name}: there is no such file; give the path of a .BIN, .tlog or .csv")
    return path
