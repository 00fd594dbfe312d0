"""Saves results to a file and reads them without loss: `Result.save` and `load_result`.

The file is JSON: each dataclass with its name and fields, each array once, exact (zlib, base64, little
endian). For other programs there is `identification.json` of a report.
"""

from __future__ import annotations

import base64
import dataclasses
import hashlib
import json
import math
import zlib
from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from rover_sweep._version import __version__
from rover_sweep.api.moved_modules import module_of
from rover_sweep.errors import UsageError
from rover_sweep.files.documents import read_json
from rover_sweep.identification.structure.state_space import ModelStructure
from rover_sweep.identification.structure.toml_form import structure_from_text

FORMAT, FORMAT_VERSION = "rover-sweep result", 1
IS = "is"  # key of the type of an object


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
        return {IS: _address(type(value)), "of": own}
    if callable(value):
        return {IS: "function", "of": _address(value)}
    raise TypeError(f"{type(value).__name__} cannot be saved: {value!r}")


def _address(thing: Any) -> str:
    """module:name of a class or function of this project that can be found by it."""
    address = f"{thing.__module__}:{thing.__qualname__}"
    if _found(address) is not thing:
        raise TypeError(f"{address} cannot be saved: it cannot be found by that name")
    return address


def _found(address: str) -> Any:
    module, _, name = address.partition(":")
    if module.partition(".")[0] != "rover_sweep" or "." in name:
        raise TypeError(f"{address} is not part of rover-sweep")
    return getattr(import_module(module_of(module)), name)


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
        case "function":
            return _function(of)
        case "float" | "complex" | "path":
            simple: dict[str, Callable[[str], Any]] = {"float": float, "complex": complex, "path": Path}
            return simple[kind](of)
    made = _found(kind)
    if not (isinstance(made, type) and dataclasses.is_dataclass(made)):
        raise TypeError(f"{kind} is not a dataclass")
    own = {name: _decoded(item, arrays) for name, item in of.items()}
    if made is ModelStructure and own.get("source"):  # a user's own structure is built from its text
        own["build"] = structure_from_text(own["source"]).build
    return made(**own)


def _function(address: str) -> Callable[..., Any]:
    """A function of `identification.models`; others are refused, so that a file cannot call any code."""
    if not module_of(address.partition(":")[0]).startswith("rover_sweep.identification.models."):
        raise TypeError(f"{address} does not build a model")
    found: Callable[..., Any] = _found(address)
    return found
