"""Every log measured once: the values are saved as they come, so that a restart goes on where it stopped."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

from rover_sweep.batch.finished_work import Progress, finished
from rover_sweep.batch.log_sources import content_key
from rover_sweep.batch.measure import made_by, measure
from rover_sweep.batch.vehicle_files import VehicleFiles
from rover_sweep.errors import DataRefused
from rover_sweep.files.documents import read_json
from rover_sweep.files.replaced import write_file
from rover_sweep.season.measured_log import MeasuredLog, from_document


def measured_logs(
    sources: Sequence[str],
    files: VehicleFiles,
    kept: Path,
    pool: Executor,
    progress: Progress = lambda done, left: None,
) -> tuple[MeasuredLog, ...]:
    """All logs in the order of the sources. kept: folder of the saved values. pool: the workers.

    RoverSweepError where the workers are lost; what is done is kept.
    """
    paths = {source: kept / f"{_key(source)}.json" for source in sources}
    found = {source: log for source in sources if (log := _saved(paths[source], source, files)) is not None}
    rest = {source: (source, files) for source in sources if source not in found}
    for source, document in finished(pool, measure, rest, progress):
        if isinstance(document, Exception):
            found[source] = MeasuredLog(source, refused=f"{source}: its worker failed: {document}")
            continue
        found[source] = from_document(document)
        if found[source].sha256:  # it could be opened: another attempt gives the same
            write_file(paths[source], json.dumps(document) + "\n")
    return tuple(found[source] for source in sources)


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
