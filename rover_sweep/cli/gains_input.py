"""What `rover-sweep gains` reads: an identification or diagnosis, and the parameters a vehicle has."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from rover_sweep.cli.vehicle_link import unkept_link
from rover_sweep.documents import read_json
from rover_sweep.errors import LinkError, UsageError
from rover_sweep.gains.firmware import DEFAULTS, SERVO_DEFAULTS, SERVO_OUTPUTS
from rover_sweep.gains.identified import Identified, from_diagnosis, from_identification

if TYPE_CHECKING:
    from rover_sweep.vehicle.access import Access

LOGS = (".bin", ".log", ".tlog")


def identified(place: Path, name: str | None) -> Identified:
    """Of an identification.json, a saved result, a diagnosis, or a folder that holds one of them."""
    path = _file(place)
    document = _json(path)
    try:
        if document.get("format") == "rover-sweep identification":
            return from_identification(document, name)
        if document.get("format") == "rover-sweep diagnosis" or _saved(document, ":FullDiagnosis"):
            return _diagnosed(path, name)
        if _saved(document, ":Result"):
            return from_identification(_result_document(path), name)
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise UsageError(
            f"{path} carries no gains ({type(error).__name__}: {error}); identify again"
        ) from error
    raise UsageError(f"{path} is neither an identification nor a diagnosis of rover-sweep")


def parameters_of(path: Path) -> dict[str, float]:
    """Those of a .param file or of a log."""
    if path.suffix.lower() in LOGS:
        return _logged(path)
    from firmware_params.check import read

    try:
        return {wanted.name: wanted.value for wanted in read(path)}
    except (OSError, ValueError) as error:
        raise UsageError(f"{path} cannot be read as parameters: {error}") from None


def parameters_over(url: str, access: Access) -> dict[str, float]:
    """Those of a vehicle; only reads."""
    from rover_sweep.vehicle.parameters import read_present

    names = set(DEFAULTS) | {
        f"SERVO{n}_{key}" for n in range(1, SERVO_OUTPUTS + 1) for key in ("FUNCTION", *SERVO_DEFAULTS)
    }
    with unkept_link(url, access) as link:
        found = read_present(link, names)
    if "ATC_STR_RAT_FF" not in found:
        raise LinkError(f"{url} has no ATC_STR_RAT_FF: is it a rover?")
    return found


def _file(place: Path) -> Path:
    if place.is_file():
        return place
    for folder in (place, place / "report"):
        for name in ("identification.json", "diagnosis.json"):
            if (folder / name).is_file():
                return folder / name
    raise UsageError(f"{place} holds no identification; give the --out folder of identify, run or diagnose")


def _json(path: Path) -> dict[str, Any]:
    try:
        document = read_json(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise UsageError(f"{path} cannot be read as an identification: {error}") from None
    if not isinstance(document, dict):
        raise UsageError(f"{path} is neither an identification nor a diagnosis of rover-sweep")
    return document


def _saved(document: dict[str, Any], kind: str) -> bool:
    saved = document.get("result")
    return isinstance(saved, dict) and str(saved.get("is", "")).endswith(kind)


def _result_document(path: Path) -> dict[str, Any]:
    from rover_sweep.api import load_result
    from rover_sweep.report.document import identification_document

    result = load_result(path)
    return identification_document(result, result.origin)


def _diagnosed(path: Path, name: str | None) -> Identified:
    from rover_sweep.cli.export_diagnosis import model_of

    model, verdict = model_of(path)
    if name not in (None, model.baseline):
        raise UsageError(f"{path} holds the {model.baseline} model; leave --model {name} out")
    return from_diagnosis(model, verdict)


def _logged(path: Path) -> dict[str, float]:
    from rover_sweep.logs.flash_channels import read_dataflash

    if path.suffix.lower() == ".tlog":
        raise UsageError(f"{path}: a telemetry log need not hold all parameters; give the .BIN, or --connect")
    found = dict(read_dataflash(path)[-1].parameters)
    if "ATC_STR_RAT_FF" not in found:
        raise UsageError(
            f"{path} holds no ATC_STR_RAT_FF: give a log of a rover that began with its parameters"
        )
    return found
