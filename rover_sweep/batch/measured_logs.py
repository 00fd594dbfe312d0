"""Every log measured once: the values are saved as they come, so that a restart goes on where it stopped."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

from rover_sweep.batch.log_sources import content_key
from rover_sweep.batch.measure import made_by, measure
from rover_sweep.batch.vehicle_files import VehicleFiles
from rover_sweep.errors import DataRefused, RoverSweepError
from rover_sweep.files.documents import read_json
from rover_sweep.files.replaced import write_file
from rover_sweep.season.measured_log import MeasuredLog, from_document

Progress = Callable[[int, int], None]


def measured_logs(
    sources: Sequence[str],
    files: VehicleFiles,
    kept: Path,
    pool: Callable[[], AbstractContextManager[Executor]],
    progress: Progress = lambda done, left: None,
) -> tuple[MeasuredLog, ...]:
    """All logs in the order of the sources. kept: folder of the saved values. pool: makes the workers.

    progress(logs done now, logs to do now). RoverSweepError where the workers are lost; what is done is kept.
    """
    paths = {source: kept / f"{_key(source)}.json" for source in sources}
    found = {source: log for source in sources if (log := _saved(paths[source], source, files)) is not None}
    rest = [source for source in sources if source not in found]
    progress(0, len(rest))
    if rest:
        found |= _new(rest, files, paths, pool, progress)
    return tuple(found[source] for source in sources)


def _new(
    rest: Sequence[str],
    files: VehicleFiles,
    paths: Mapping[str, Path],
    pool: Callable[[], AbstractContextManager[Executor]],
    progress: Progress,
) -> dict[str, MeasuredLog]:
    found: dict[str, MeasuredLog] = {}
    with pool() as executor:
        futures = {executor.submit(measure, source, files): source for source in rest}
        try:
            for future in as_completed(futures):
                source = futures[future]
                try:
                    document = future.result()
                except BrokenProcessPool:
                    raise
                except Exception as error:  # the worker was lost more often than the cluster retries
                    found[source] = MeasuredLog(source, refused=f"{source}: its worker failed: {error}")
                else:
                    found[source] = from_document(document)
                    if found[source].sha256:  # it could be opened: another attempt gives the same
                        write_file(paths[source], json.dumps(document) + "\n")
                progress(len(found), len(rest))
        except BrokenProcessPool:
            raise RoverSweepError(
                f"a worker process ended unexpectedly (killed, or out of memory) after {len(found)} of "
                f"{len(rest)} logs; finished logs are kept: run the same command again"
            ) from None
        except BaseException:
            executor.shutdown(wait=False, cancel_futures=True)
            raise
    return found


def _key(source: str) -> str:
    """Name of the saved values: of the place and the contents of a log."""
    return hashlib.sha256(f"{source}\0{content_key(source)}".encode()).hexdigest()[:24]


def _saved(path: Path, source: str, files: VehicleFiles) -> MeasuredLog | None:
    """The saved values, None where there are none or they depend on something else now."""
    try:
        document: dict[str, Any] = read_json(path.read_text(encoding="utf-8"))
        log = from_document(document)
        name = log.vehicle_file
        if log.day or log.parameters:  # it was read, so the choice of its file can be repeated
            name = _file_name(files, source, log.board)
        same = name == log.vehicle_file and document["made_by"] == made_by(name, files)
        return log if same else None
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _file_name(files: VehicleFiles, source: str, board: str) -> str:
    try:
        return files.of(source, board)[0]
    except DataRefused:
        return ""
