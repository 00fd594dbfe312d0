"""The work on one log, wherever it runs: read it, find its runs, fit them; a log never raises."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path
from typing import Any

from rover_sweep._version import __version__
from rover_sweep.api.read import with_delta
from rover_sweep.batch.log_sources import local_file
from rover_sweep.batch.vehicle_files import VehicleFiles
from rover_sweep.data.recording import Recording
from rover_sweep.data.vehicle_file import parse
from rover_sweep.data.vehicle_geometry import geometry_of
from rover_sweep.errors import DataRefused, RoverSweepError
from rover_sweep.logs.log import Log
from rover_sweep.logs.read import read_logs, runs_of
from rover_sweep.logs.recorded_day import recorded_day
from rover_sweep.logs.runs.board import identity
from rover_sweep.season.fitted_log import FittedLog, fitted_log
from rover_sweep.season.measured_log import MeasuredLog, as_document

SHORTEST = 5.0  # s of manoeuvres in a log that is fitted


def measure(source: str, files: VehicleFiles) -> dict[str, Any]:
    """The values of one log as plain JSON types, with its sentence where it cannot be used."""
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
    """What the values depend on beside the log: the version, and the contents of the vehicle file."""
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
    runs = tuple(with_delta(run, vehicle) for run in _runs(logs))
    usable = [run for run in runs if {"delta", "r", "speed"} <= set(run.channels)]
    seconds = sum(run.span[1] - run.span[0] for run in usable)
    if seconds < SHORTEST:
        raise DataRefused(
            f"{logs[0].name}: only {seconds:.1f} s of runs with steering, yaw rate and speed; "
            f"at least {SHORTEST:g} s are needed"
        )
    return fitted_log(usable, geometry_of(vehicle))


def _runs(logs: tuple[Log, ...]) -> tuple[Recording, ...]:
    """The runs of all parts of a log; a refused part does not spoil the others."""
    runs: list[Recording] = []
    refusals: list[DataRefused] = []
    for whole in logs:
        try:
            runs += runs_of(whole)
        except DataRefused as refusal:
            refusals.append(refusal)
    if not runs:
        raise refusals[0] if refusals else DataRefused(f"{logs[0].name} holds no run")
    return tuple(runs)
