"""Finds files of results, saves results and reads them without loss: `Result.save` and `load_result`.

The file is JSON: each dataclass with its name and fields, each array once, exact (zlib, base64, little
endian). It names no module, so the classes may move; their names are unique. For other programs there is
`identification.json` of a report.
"""

from __future__ import annotations

import base64
import dataclasses
import hashlib
import json
import math
import sys
import zlib
from collections.abc import Callable, Mapping
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from rover_sweep._version import __version__
from rover_sweep.errors import UsageError
from rover_sweep.files.documents import read_json
from rover_sweep.identification.state_space import ModelStructure
from rover_sweep.identification.toml_form import structure_from_text

FORMAT, FORMAT_VERSION = "rover-sweep result", 2
HOMES = ("api.identify", "api.diagnose", "identification.pipeline", "diagnosis.diagnose")
"""Modules whose import loads every class that a result may hold."""
BUILDERS = "rover_sweep.identification.models"  # of the functions that build the known models
IS = "is"  # key of the type of an object


def holds(document: Any, kind: str) -> bool:
    """Whether the JSON is a saved result of this class, such as "FullDiagnosis"."""
    saved = document.get("result") if isinstance(document, dict) else None
    return isinstance(saved, dict) and saved.get(IS) == kind


def result_file(place: Path, *names: str) -> Path | None:
    """A file itself, else the first of these names in the folder or its report/; None without one."""
    folders = (place, place / "report")
    return (
        place
        if place.is_file()
        else next((folder / name for folder in folders for name in names if (folder / name).is_file()), None)
    )


def result_document(path: Path) -> dict[str, Any]:
    """The JSON object in a file of results; UsageError for any other file."""
    try:
        document = read_json(text_of(path))
    except ValueError as error:
        raise UsageError(f"{path} cannot be read as results of rover-sweep: {error}") from None
    if not isinstance(document, dict):
        raise UsageError(f"{path} is not a file of results of rover-sweep")
    return document


def is_diagnosis(document: Any) -> bool:
    """Whether the JSON is a diagnosis.json or a saved diagnosis."""
    is_report = isinstance(document, dict) and document.get("format") == "rover-sweep diagnosis"
    return is_report or holds(document, "FullDiagnosis")


def text_of(path: Path) -> str:
    """The text of a file; UsageError where it cannot be read."""
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(f"{path} cannot be read: {error}") from None


def dumps(value: Any) -> str:
    """The value as text; TypeError for a type that cannot be saved."""
    arrays: dict[str, list[Any]] = {}
    coded = _coded(value, arrays)
    return json.dumps(
        {
            "format": FORMAT,
            "format_version": FORMAT_VERSION,
            "rover_sweep": __version__,
            "result": coded,
            "arrays": arrays,
        },
        allow_nan=False,
    )


def loads(text: str, name: str = "the file") -> Any:
    """The value that `dumps` wrote; UsageError for other text. name: of the file, in errors."""
    try:
        document = read_json(text)
    except ValueError as error:
        raise UsageError(f"{name} is not JSON ({error}); give a file that Result.save wrote") from None
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        found = document.get("format") if isinstance(document, dict) else type(document).__name__
        if found == "rover-sweep identification":
            raise UsageError(
                f"{name} is the document of a report, which has the numbers without the recordings: read it "
                "with json.load, or save a result by result.save(path) and load that"
            )
        raise UsageError(
            f"{name} is not a saved result (its format is {found!r}); give a file that Result.save wrote"
        )
    if document.get("format_version") != FORMAT_VERSION:
        raise UsageError(
            f"{name} has version {document.get('format_version')} of the format, written by rover-sweep "
            f"{document.get('rover_sweep')}; this version reads format {FORMAT_VERSION}: identify again"
        )
    try:
        arrays = {key: _unpacked(*packed) for key, packed in document["arrays"].items()}
        return _decoded(document["result"], arrays)
    except (KeyError, TypeError, ValueError, AttributeError, ImportError, zlib.error) as error:
        raise UsageError(
            f"{name}, written by rover-sweep {document.get('rover_sweep')}, cannot be read by {__version__} "
            f"({type(error).__name__}: {error}); identify again"
        ) from error


def _coded(value: Any, arrays: dict[str, list[Any]]) -> Any:
    match value:
        case None | bool() | str() | int():
            return value
        case np.ndarray():
            return {IS: "array", "of": _packed(value, arrays)}
        case np.generic():
            return _coded(value.item(), arrays)
        case float():
            return value if math.isfinite(value) else {IS: "float", "of": repr(value)}
        case complex():
            return {IS: "complex", "of": repr(value)}
        case tuple() | list():
            return [_coded(item, arrays) for item in value]
        case Mapping():
            return {IS: "mapping", "of": [[k, _coded(item, arrays)] for k, item in value.items()]}
        case Path():
            return {IS: "path", "of": str(value)}
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        left_out = {"build"} if isinstance(value, ModelStructure) and value.source else set()
        names = [f.name for f in dataclasses.fields(value) if f.init and f.name not in left_out]
        own = {name: _coded(getattr(value, name), arrays) for name in names}
        if _kinds().get(type(value).__name__) is not type(value):
            raise TypeError(f"{type(value).__name__} is not a part of a result")
        return {IS: type(value).__name__, "of": own}
    if callable(value) and getattr(value, "__module__", "") == BUILDERS:
        return {IS: "function", "of": value.__name__}
    raise TypeError(f"{type(value).__name__} cannot be saved: {value!r}")


@cache
def _kinds() -> dict[str, type]:
    """{name: dataclass} of this project."""
    for home in HOMES:
        import_module(f"rover_sweep.{home}")
    loaded = [module for name, module in sys.modules.items() if name.startswith("rover_sweep.")]
    own = [(module.__name__, thing) for module in loaded for thing in vars(module).values()]
    return {
        thing.__name__: thing
        for home, thing in own
        if isinstance(thing, type) and dataclasses.is_dataclass(thing) and thing.__module__ == home
    }


def _packed(array: np.ndarray, arrays: dict[str, list[Any]]) -> str:
    """Stores the array and returns its key; equal arrays share one."""
    plain = np.ascontiguousarray(array, array.dtype.newbyteorder("<"))
    raw = plain.tobytes()
    key = hashlib.sha256(raw + repr((plain.dtype.str, array.shape)).encode()).hexdigest()[:16]
    if key not in arrays:
        text = base64.b64encode(zlib.compress(raw, 6)).decode("ascii")
        arrays[key] = [plain.dtype.str, list(array.shape), text]
    return key


def _unpacked(kind: str, shape: list[int], text: str) -> np.ndarray:
    flat = np.frombuffer(zlib.decompress(base64.b64decode(text)), np.dtype(kind))
    return flat.reshape(shape).astype(flat.dtype.newbyteorder("="))


def _decoded(value: Any, arrays: Mapping[str, np.ndarray]) -> Any:
    if isinstance(value, list):
        return tuple(_decoded(item, arrays) for item in value)
    if not isinstance(value, dict):
        return value
    kind, of = value[IS], value["of"]
    match kind:
        case "array":
            return arrays[of]
        case "mapping":
            return {key: _decoded(item, arrays) for key, item in of}
        case "function":  # others are refused, so that a file cannot call any code
            if not of.endswith("_matrices"):
                raise TypeError(f"{of} does not build a model")
            return getattr(import_module(BUILDERS), of)
        case "float" | "complex" | "path":
            simple: dict[str, Callable[[str], Any]] = {"float": float, "complex": complex, "path": Path}
            return simple[kind](of)
    made = _kinds().get(kind)
    if made is None:
        raise TypeError(f"{kind} is not a part of a result")
    own = {name: _decoded(item, arrays) for name, item in of.items()}
    if made is ModelStructure and own.get("source"):  # a user's own structure is built from its text
        own["build"] = structure_from_text(own["source"]).build
    return made(**own)
