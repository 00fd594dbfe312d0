"""The season of measured logs, with the vehicle files that they were measured with."""

from __future__ import annotations

import hashlib
import json
import tempfile
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from contextlib import ExitStack, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from threadpoolctl import threadpool_limits

from rover_sweep._version import __version__
from rover_sweep.api.diagnose import diagnose
from rover_sweep.api.read import read
from rover_sweep.batch.measured_logs import Progress, VehicleFiles, finished, local_file
from rover_sweep.data.vehicle_file import parse
from rover_sweep.data.vehicle_geometry import geometry_of
from rover_sweep.errors import RoverSweepError
from rover_sweep.files.documents import read_json, write_file
from rover_sweep.report.diagnosis.report import write_diagnosis
from rover_sweep.report.in_html import in_html
from rover_sweep.report.season_report import page_names, vehicle_report
from rover_sweep.season.season import season
from rover_sweep.season.season_result import MeasuredLog, Season, VehicleSeason
from rover_sweep.spectra.side_by_side import one_thread


@threadpool_limits.wrap(limits=1, user_api="blas")  # so that sums do not depend on the number of threads
def season_of_logs(logs: Sequence[MeasuredLog], files: VehicleFiles) -> Season:
    """The season; the result depends on the logs and files only."""
    used = sorted({log.vehicle_file for log in logs if log.fit is not None})
    return season(logs, {name: geometry_of(parse(files.texts[name], name)) for name in used})


FILES = ("diagnosis.html", "diagnosis.json")
Sentences = dict[tuple[str, str], str]  # {(vehicle, day): sentence}


def diagnosed_days(
    season: Season,
    logs: Sequence[MeasuredLog],
    files: VehicleFiles,
    out: Path,
    pool: Executor,
    progress: Progress = lambda done, left: None,
) -> Sentences:
    """Diagnose the logs of each day; reports in out/diagnoses/<page of the vehicle>/<day>.

    Returns the sentence of each day. Days that were diagnosed before are not diagnosed again.
    """
    known = {log.source: log for log in logs}
    names = page_names(season)
    sets = {(v.name, day): sources for v in season.vehicles for day, sources in v.logs.items()}
    folders = {key: out / "diagnoses" / names[key[0]] / key[1] for key in sets}
    keys = {key: _key([known[s] for s in sources], files) for key, sources in sets.items()}
    found: Sentences = {}
    for key in sets:
        with suppress(OSError, ValueError, KeyError, TypeError):
            done: Mapping[str, Any] = read_json((folders[key] / "done.json").read_text(encoding="utf-8"))
            if done["made_by"] == keys[key]:
                found[key] = str(done["sentence"])
    rest = {
        key: (sources, known[sources[0]].vehicle_file, files.texts[known[sources[0]].vehicle_file])
        for key, sources in sets.items()
        if key not in found
    }
    for key, result in finished(pool, diagnose_day, rest, progress):
        if isinstance(result, Exception):
            found[key] = f"its worker failed: {result}"
            continue
        for name, text in result["files"].items():
            write_file(folders[key] / name, text)
        found[key] = result["sentence"]
        kept = {"made_by": keys[key], "sentence": found[key]}
        write_file(folders[key] / "done.json", json.dumps(kept) + "\n")
    return {key: found[key] for key in sets}


def diagnose_day(sources: Sequence[str], name: str, text: str) -> dict[str, Any]:
    """{"sentence", "files": {name: contents}} of the logs of one day; a refusal is the sentence."""
    try:
        with ExitStack() as stack, tempfile.TemporaryDirectory(prefix="rover-sweep-") as folder:
            paths = [str(stack.enter_context(local_file(source))) for source in sources]
            with one_thread():
                found = diagnose(read(*paths, vehicle=parse(text, name)))
            origin = replace(found.origin, provenance=replace(found.origin.provenance, made=""))
            write_diagnosis(replace(found, seconds=0.0), Path(folder), origin)
            written = {file: (Path(folder) / file).read_text(encoding="utf-8") for file in FILES}
    except RoverSweepError as error:
        return {"sentence": str(error), "files": {}}
    except Exception as error:  # the other days go on
        return {"sentence": f"an internal error, {type(error).__name__}: {error}", "files": {}}
    return {"sentence": f"{found.verdict}: {found.sentence}", "files": written}


def _key(logs: Sequence[MeasuredLog], files: VehicleFiles) -> str:
    """A key of the logs, the vehicle file and the version."""
    parts = [__version__, files.digest(logs[0].vehicle_file), *(log.sha256 for log in logs)]
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()


def drawn_pages(season: Season, diagnoses: Mapping[tuple[str, str], str], pool: Executor) -> dict[str, str]:
    """{vehicle: its page}. diagnoses: {(vehicle, day): sentence}."""
    given = {
        v.name: (v, {day: text for (name, day), text in diagnoses.items() if name == v.name})
        for v in season.vehicles
    }
    out = {}
    for name, result in finished(pool, draw_page, given, lambda done, left: None):
        if isinstance(result, Exception):
            raise result
        out[name] = result["page"]
    return out


def draw_page(vehicle: VehicleSeason, diagnoses: Mapping[str, str]) -> dict[str, Any]:
    """{"page": HTML} of a vehicle. diagnoses: {day: sentence}."""
    return {"page": in_html(vehicle_report(vehicle, diagnoses))}
