"""Steering gains from a file of results and the vehicle's current parameters."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from rover_sweep.api.save import holds
from rover_sweep.data.vehicle_file import load as load_vehicle
from rover_sweep.errors import UsageError
from rover_sweep.files.documents import read_json
from rover_sweep.gains.identified import PHYSICAL, Identified, from_diagnosis, from_identification
from rover_sweep.gains.proposal import Proposal, propose_gains
from rover_sweep.gains.steering_chain import autopilot

LOGS = (".bin", ".log", ".tlog")


def steering_gains(
    place: Path,
    name: str | None,
    vehicle_file: str | None,
    current: Mapping[str, float],
    current_from: str,
    speed: float | None,
) -> Proposal:
    """Current and proposed gains.

    place: file or folder of an identification or diagnosis. name: of the model, None for the recommended
    one. vehicle_file: with rad_per_us, if the results have none. current: {parameter: value} of the
    vehicle, empty for the firmware's defaults; current_from: their origin, for errors. speed: design speed
    [m/s], None for that of the runs. UsageError for files from which no gains can be computed.
    """
    if name is not None and name not in PHYSICAL:
        raise UsageError(
            f"--model {name}: gains need a model that is valid at other speeds: {', '.join(PHYSICAL)}"
        )
    found = read_identified(place, name)
    if vehicle_file:
        found = replace(found, rad_per_us=load_vehicle(vehicle_file).steering()[1])
    known = (("INS_GYRO_FILTER", found.gyro_hz), ("SCHED_LOOP_RATE", found.loop_hz))
    try:
        loop = autopilot(current, {name: value for name, value in known if value is not None})
    except ValueError as error:
        raise UsageError(f"{current_from}: {error}") from None
    try:
        return propose_gains(found, loop, speed)
    except ValueError as error:
        raise UsageError(f"no loop can be computed: {error}") from None


def read_identified(place: Path, name: str | None) -> Identified:
    """The model of an identification.json, a saved result, a diagnosis, or a folder with one of them."""
    path = _file(place)
    document = _json(path)
    try:
        if document.get("format") == "rover-sweep identification":
            return from_identification(document, name)
        if document.get("format") == "rover-sweep diagnosis" or holds(document, "FullDiagnosis"):
            return _diagnosed(path, name)
        if holds(document, "Result"):
            return from_identification(_result_document(path), name)
    except (KeyError, TypeError, ValueError, IndexError) as error:
        why = {KeyError: f"{error} is missing", ValueError: str(error)}.get(
            type(error), "a part of it has another form"
        )
        raise UsageError(f"no gains can be computed from {path}: {why}; run identify again") from error
    raise UsageError(f"{path} is neither an identification nor a diagnosis of rover-sweep")


def recorded_parameters(path: Path) -> dict[str, float]:
    """Parameters by name from a .param file or a log; UsageError if unreadable or impossible."""
    from firmware_params.param_files import read

    try:
        logged = path.suffix.lower() in LOGS
        found = _logged(path) if logged else {wanted.name: wanted.value for wanted in read(path)}
    except (OSError, ValueError) as error:
        raise UsageError(f"{path} cannot be read as parameters: {error}") from None
    for name, value in found.items():
        if name.startswith("ATC_STR_RAT_") and not 0.0 <= value < math.inf:
            raise UsageError(f"{path}: {name} is {value:g}; it must be 0 or more: save the parameters again")
    return found


def _file(place: Path) -> Path:
    if place.is_file():
        return place
    for folder in (place, place / "report"):
        for name in ("identification.json", "diagnosis.json"):
            if (folder / name).is_file():
                return folder / name
    raise UsageError(
        f"{place} contains no identification; give the --out folder of identify, run or diagnose"
    )


def _json(path: Path) -> dict[str, Any]:
    try:
        document = read_json(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise UsageError(f"{path} cannot be read as an identification: {error}") from None
    if not isinstance(document, dict):
        raise UsageError(f"{path} is neither an identification nor a diagnosis of rover-sweep")
    return document


def _result_document(path: Path) -> dict[str, Any]:
    from rover_sweep.api.identify import load_result
    from rover_sweep.report.identification.identification_json import identification_document

    result = load_result(path)
    return identification_document(result, result.origin)


def _diagnosed(path: Path, name: str | None) -> Identified:
    from rover_sweep.api.diagnose import load_diagnosis

    found = load_diagnosis(path)
    if name not in (None, found.baseline):
        raise UsageError(f"{path} has the {found.baseline} model; remove --model {name}")
    return from_diagnosis(found)


def _logged(path: Path) -> dict[str, float]:
    from rover_sweep.logs.readers.dataflash_channels import read_dataflash

    if path.suffix.lower() == ".tlog":
        raise UsageError(f"{path}: a .tlog does not always hold all parameters; give the .BIN, or --connect")
    found = dict(read_dataflash(path)[-1].parameters)
    if "ATC_STR_RAT_FF" not in found:
        raise UsageError(f"{path} has no ATC_STR_RAT_FF: give a rover's log that includes its parameters")
    return found
