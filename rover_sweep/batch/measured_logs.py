"""Every log measured once: the values are saved as they come, so that a restart continues there."""

from __future__ import annotations

import hashlib
import json
import multiprocessing
import os
import tempfile
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

from rover_sweep._version import __version__
from rover_sweep.api.read import with_delta
from rover_sweep.data.recording import Recording
from rover_sweep.data.vehicle_file import parse
from rover_sweep.data.vehicle_geometry import geometry_of
from rover_sweep.errors import DataRefused, RoverSweepError, UsageError, missing_extra
from rover_sweep.files.documents import read_json, read_toml, write_file
from rover_sweep.logs.applet import identity
from rover_sweep.logs.log import Log
from rover_sweep.logs.read import read_logs, recorded_day, runs_of
from rover_sweep.season.season_result import FittedLog, MeasuredLog, as_document, fitted_log, from_document
from rover_sweep.system import end_with_parent, processors

KINDS = (".bin", ".tlog")


def log_sources(given: Sequence[str]) -> tuple[str, ...]:
    """All logs, each once, in order of their names: given files, and those in folders and URLs with `*`.

    In folders a .tlog beside the .BIN of the same name is left out, as both are of one drive. UsageError
    where a folder holds no log.
    """
    found: dict[str, None] = {}
    for source in given:
        path = Path(source).expanduser()
        if "://" in source:  # a URL that fsspec opens, such as s3://bucket/log.BIN
            names = _of_url(source)
        elif path.is_dir():
            inside = [str(p) for p in sorted(path.rglob("*")) if p.suffix.lower() in KINDS]
            names = _without_pairs(source, inside)
        else:
            names = [str(path)]
        found |= dict.fromkeys(names)
    return tuple(sorted(found))


def _of_url(source: str) -> list[str]:
    fs, path = _opened(source)
    try:
        if "*" in path:
            return [fs.unstrip_protocol(p) for p in sorted(fs.glob(path))]
        if fs.isdir(path):
            every = [fs.unstrip_protocol(p) for p in sorted(fs.find(path))]
            return _without_pairs(source, [p for p in every if p.lower().endswith(KINDS)])
    except Exception as error:  # each file system has errors of its own
        raise UsageError(f"{source} cannot be listed: {error}") from None
    return [source]


def _without_pairs(source: str, names: Sequence[str]) -> list[str]:
    if not names:
        raise UsageError(f"{source} holds no .BIN and no .tlog; give logs or a folder with logs")
    flash = {name[:-4] for name in names if name.lower().endswith(".bin")}
    return [name for name in names if not (name.lower().endswith(".tlog") and name[:-5] in flash)]


def content_key(source: str) -> str:
    """A hash that changes with the contents: a file's sha256, or fsspec's key of a URL; "" for none."""
    try:
        if "://" in source:
            fs, path = _opened(source)
            return str(fs.ukey(path))
        with open(source, "rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except Exception:  # the sentence comes with the attempt to read it
        return ""


@contextmanager
def local_file(source: str) -> Iterator[Path]:
    """The log as a local file; for a URL a temporary copy. DataRefused if it cannot be read."""
    if "://" not in source:
        yield Path(source)
        return
    with tempfile.TemporaryDirectory(prefix="rover-sweep-") as folder:
        copy = Path(folder) / source.rpartition("/")[2]
        try:
            fs, path = _opened(source)
            fs.get_file(path, str(copy))
        except UsageError:
            raise
        except Exception as error:
            raise DataRefused(f"{source} cannot be read: {error or type(error).__name__}") from None
        yield copy


def _opened(source: str) -> tuple[Any, str]:
    try:
        from fsspec.core import url_to_fs
    except ImportError:
        raise missing_extra(f"{source} is a URL and needs fsspec", "fleet") from None
    try:
        fs, path = url_to_fs(source)
    except Exception as error:
        raise UsageError(f"{source} cannot be opened: {error}") from None
    return fs, str(path)


# Where the work runs: local processes (concurrent.futures) or a Dask cluster (dask.distributed).


RETRIES = 3  # by Dask, of a log whose worker failed


@contextmanager
def workers(count: int | None, scheduler: str | None) -> Iterator[Executor]:
    """An executor. scheduler: address of a Dask cluster, None for `count` local processes."""
    if scheduler is None:
        os.environ.setdefault("OMP_NUM_THREADS", "1")  # of the processes that start now
        context = multiprocessing.get_context("spawn")  # as on every platform, and no copied locks
        with ProcessPoolExecutor(count or processors(), context, end_with_parent) as pool:
            yield pool
        return
    try:
        from distributed import Client
    except ImportError:
        raise missing_extra("--scheduler needs Dask", "fleet") from None
    try:
        client = Client(scheduler, timeout="20s")
    except (OSError, ValueError) as error:
        raise UsageError(
            f"no Dask scheduler answers at {scheduler} ({error}); start one with: dask scheduler"
        ) from None
    with client, client.get_executor(retries=RETRIES, pure=False) as pool:
        yield pool


Key = TypeVar("Key")
Progress = Callable[[int, int], None]
"""progress(done now, to do now)."""


def finished(
    pool: Executor,
    work: Callable[..., dict[str, Any]],
    given: Mapping[Key, tuple[Any, ...]],
    progress: Progress,
) -> Iterator[tuple[Key, dict[str, Any] | Exception]]:
    """(key, result of work(*arguments)) in the order in which they end.

    An exception instead of a result where a worker failed more often than the cluster retries.
    RoverSweepError where the local processes are lost.
    """
    progress(0, len(given))
    futures: dict[Future[dict[str, Any]], Key] = {}
    done = 0
    try:
        futures |= {pool.submit(work, *arguments): key for key, arguments in given.items()}
        for future in as_completed(futures):
            result: dict[str, Any] | Exception
            try:
                result = future.result()
            except BrokenProcessPool:
                raise
            except Exception as error:
                result = error
            yield futures[future], result
            done += 1
            progress(done, len(given))
    except BrokenProcessPool:
        raise RoverSweepError(
            f"a worker process ended unexpectedly (killed, or out of memory) after {done} of {len(given)}; "
            "finished work is kept: run the same command again"
        ) from None
    finally:
        for future in futures:
            future.cancel()  # what has not begun, after an error or Ctrl-C


# The vehicle files of a fleet, and which one belongs to a log.
#
# A folder holds one file per vehicle, named after it: rover-07.toml. A log belongs to it when one of its
# folders or the beginning of its own name is `rover-07`, or when fleet.toml in the same folder lists its
# board:
#
#     [boards]
#     rover-07 = ["CubeOrange 0028001F 3432510D 37343231"]
#
# rover.toml in the folder is for all other logs.


EVERY, FLEET = "rover", "fleet"  # stems of the file for all other logs, and of the list of boards


@dataclass(frozen=True)
class VehicleFiles:
    """texts: {name: contents}. boards: {board: name}. beside: {folder of logs: name} of files found there."""

    texts: Mapping[str, str]
    boards: Mapping[str, str] = field(default_factory=dict)
    beside: Mapping[str, str] = field(default_factory=dict)

    def of(self, source: str, board: str) -> tuple[str, str]:
        """(name of the file, name of the vehicle or "") for a log; DataRefused where there is none."""
        if board in self.boards:
            return self.boards[board], self.boards[board]
        *folders, own = source.replace("\\", "/").split("/")
        for part in reversed(folders):
            if part in self.texts and part != EVERY:
                return part, part
        starts = [name for name in self.texts if own.startswith(name) and name != EVERY]
        if starts:
            name = max(starts, key=len)
            return name, name
        folder = "/".join(folders)
        if folder in self.beside:
            return self.beside[folder], ""
        if EVERY in self.texts:
            return EVERY, ""
        raise DataRefused(
            f"no vehicle file for {own}{f' of the board {board}' if board else ''}: give --vehicles with a "
            f"file named after its folder, with {FLEET}.toml that lists its board, or with {EVERY}.toml"
        )

    def digest(self, name: str) -> str:
        """sha256 of a file's contents, "" for none."""
        return hashlib.sha256(self.texts[name].encode()).hexdigest() if name in self.texts else ""


def read_vehicle_files(folder: Path) -> VehicleFiles:
    """All vehicle files of a folder, checked; UsageError where one is wrong."""
    paths = sorted(folder.glob("*.toml"))
    if not paths:
        raise UsageError(f"{folder} holds no vehicle file; put rover.toml or one NAME.toml per vehicle there")
    texts = {path.stem: _text(path) for path in paths}
    boards = _boards(texts.pop(FLEET, ""), folder / f"{FLEET}.toml", texts)
    for name, text in texts.items():
        parse(text, str(folder / f"{name}.toml")).steering()
    return VehicleFiles(texts, boards)


def files_beside(sources: Sequence[str]) -> VehicleFiles:
    """rover.toml in the folder of each local log, or in the folder above it."""
    texts, beside = {}, {}
    for folder in sorted({source.replace("\\", "/").rpartition("/")[0] for source in sources}):
        if "://" in folder:
            continue
        place = Path(folder or ".")
        for path in (place / f"{EVERY}.toml", place.parent / f"{EVERY}.toml"):
            if path.is_file():
                name = str(path)
                texts[name] = _text(path)
                parse(texts[name], name).steering()
                beside[folder] = name
                break
    return VehicleFiles(texts, {}, beside)


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(f"the vehicle file {path} cannot be read: {error}") from None


def _boards(text: str, path: Path, texts: Mapping[str, str]) -> dict[str, str]:
    try:
        table = read_toml(text).get("boards", {}) if text else {}
    except tomllib.TOMLDecodeError as error:
        raise UsageError(f"{path} is not valid TOML: {error}") from None
    out: dict[str, str] = {}
    for name, boards in table.items() if isinstance(table, dict) else ():
        if name not in texts:
            raise UsageError(f"{path} lists boards of {name}, but there is no {name}.toml beside it")
        if not isinstance(boards, list) or not all(isinstance(b, str) for b in boards):
            raise UsageError(
                f'{path}: the boards of {name} must be a list, as in {name} = ["CubeOrange ..."]'
            )
        for board in boards:
            if out.setdefault(board, name) != name:
                raise UsageError(f"{path} lists the board {board} for both {out[board]} and {name}")
    return out


SHORTEST = 5.0  # s of manoeuvres in a log that is fitted


def measure(source: str, files: VehicleFiles) -> dict[str, Any]:
    """The values of one log as plain JSON types, with the reason if it cannot be used."""
    log = MeasuredLog(source)
    try:
        with local_file(source) as path:
            log = _measured(log, path, files)
    except RoverSweepError as error:
        log = replace(log, refused=str(error))
    except Exception as error:  # a damaged log can break any reader; the others go on
        log = replace(log, refused=f"{source}: an internal error, {type(error).__name__}: {error}")
    return as_document(log) | {"made_by": made_by(log.vehicle_file, files)}


def made_by(vehicle_file: str, files: VehicleFiles) -> list[str]:
    """The values' other origins than the log: the version, and the contents of the vehicle file."""
    return [__version__, files.digest(vehicle_file)]


def _measured(log: MeasuredLog, path: Path, files: VehicleFiles) -> MeasuredLog:
    """The log, as far as it can be read: a refusal afterwards keeps day, board and parameters."""
    if path.is_file():
        with path.open("rb") as file:
            log = replace(log, sha256=hashlib.file_digest(file, "sha256").hexdigest())
    try:
        logs = read_logs(str(path))
    except RoverSweepError as error:
        return replace(log, refused=str(error))
    day, day_from = recorded_day(path, "" if str(path) == log.source else log.source)
    last = logs[-1]
    ids = identity(last)
    log = replace(
        log,
        day=day,
        day_from=day_from,
        board=ids.get("board", ""),
        system=ids.get("system id", ""),
        firmware=last.firmware,
        parameters=dict(last.parameters),
    )
    try:
        name, vehicle = files.of(log.source, log.board)
        log = replace(log, vehicle_file=name, vehicle=vehicle)
        return replace(log, fit=_fitted(logs, files.texts[name], name))
    except RoverSweepError as error:
        return replace(log, refused=str(error))


def _fitted(logs: tuple[Log, ...], text: str, name: str) -> FittedLog:
    vehicle = parse(text, name)
    found: list[Recording] = []
    refusals: list[DataRefused] = []
    for whole in logs:
        try:
            found += runs_of(whole)
        except DataRefused as refusal:  # a refused part does not spoil the others
            refusals.append(refusal)
    if not found:
        raise refusals[0] if refusals else DataRefused(f"{logs[0].name} holds no run")
    runs = [with_delta(run, vehicle) for run in found]
    usable = [run for run in runs if {"delta", "r", "speed"} <= set(run.channels)]
    seconds = sum(run.span[1] - run.span[0] for run in usable)
    if seconds < SHORTEST:
        raise DataRefused(
            f"{logs[0].name}: only {seconds:.1f} s of runs with steering, yaw rate and speed; "
            f"at least {SHORTEST:g} s are needed"
        )
    return fitted_log(usable, geometry_of(vehicle))


def measured_logs(
    sources: Sequence[str],
    files: VehicleFiles,
    kept: Path,
    pool: Executor,
    progress: Progress = lambda done, left: None,
) -> tuple[MeasuredLog, ...]:
    """All logs in the order of the sources. kept: folder of the saved values. pool: the workers.

    RoverSweepError if the workers are lost; finished logs are kept.
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
    """Name of the saved values, from the place and the contents of a log."""
    return hashlib.sha256(f"{source}\0{content_key(source)}".encode()).hexdigest()[:24]


def _saved(path: Path, source: str, files: VehicleFiles) -> MeasuredLog | None:
    """The saved values, None if there are none or if they are out of date."""
    try:
        document: dict[str, Any] = read_json(path.read_text(encoding="utf-8"))
        log = from_document(document)
        name = log.vehicle_file
        if log.day or log.parameters:  # it was read, so the choice of its file can be repeated
            name = ""
            with suppress(DataRefused):
                name = files.of(source, log.board)[0]
        same = name == log.vehicle_file and document["made_by"] == made_by(name, files)
        return log if same else None
    except (OSError, ValueError, KeyError, TypeError):
        return None
