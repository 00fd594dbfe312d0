"""Results as plain data for JSON, and back: every dataclass by its fields; cattrs checks what is read.

`ByName` is {name: the other fields}, an array a list. A document does not name classes: the reader asks for a
type. Saved results may hold anything and name their classes (`rover_sweep.api.save`).
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Any, TypeVar, get_args, get_origin

import numpy as np
from cattrs import BaseValidationError, Converter, transform_error
from cattrs.gen import make_dict_structure_fn, make_dict_unstructure_fn, override

from rover_sweep.data.results import ByName, Quantity

T = TypeVar("T")


def encoded(value: Any) -> Any:
    """A result in plain types: dict, list, str, numbers, None."""
    return _CODEC.unstructure(value)


def decoded(document: Any, kind: type[T]) -> T:
    """A result of a class; ValueError that names the place where the document does not hold one."""
    try:
        return _CODEC.structure(document, kind)
    except BaseValidationError as error:
        every = (said.rpartition(" @ $") for said in transform_error(error, format_exception=_words))
        raise ValueError("; ".join(f"{where.lstrip('.')}: {what}" for what, _, where in every)) from None
    except TypeError as error:  # no object where one is wanted
        raise ValueError(str(error)) from None


def _words(error: BaseException, _: type | None) -> str:
    if isinstance(error, KeyError):
        return "it is missing"
    return re.sub(r"not in literal typing.Literal\[(.*)\]", r"is none of \1", str(error))


def in_json(kind: type, left_out: tuple[str, ...] = (), sparse: tuple[str, ...] = (), **names: str) -> None:
    """Form of a class in JSON. left_out: fields not written; sparse: written unless at their default; names:
    {field: its key}."""
    own: dict[str, Any] = {field: override(rename=key) for field, key in names.items()}
    own |= {field: override(omit=True) for field in left_out}
    own |= {field: override(omit_if_default=True) for field in sparse}
    _CODEC.register_unstructure_hook(kind, make_dict_unstructure_fn(kind, _CODEC, **own))
    _CODEC.register_structure_hook(kind, make_dict_structure_fn(kind, _CODEC, **own))


def coded_by(kind: type[T], write: Callable[[T], Any], read_from: Callable[[Any], T]) -> None:
    """For a class whose document is not its fields. read_from raises like `decoded`."""
    _CODEC.register_unstructure_hook(kind, write)
    _CODEC.register_structure_hook(kind, lambda document, _: read_from(document))


def _number(value: Any, _: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise TypeError(f"{value!r} is not a number")
    return value


def _text(value: Any, _: Any) -> str:
    if not isinstance(value, str):
        raise TypeError(f"{value!r} is not a text")
    return value


def _all_alike(document: Any, _: Any) -> tuple[Any, ...]:
    """Numbers, or texts."""
    if not isinstance(document, list | tuple):
        raise TypeError(f"{document!r} is not a list")
    check = _text if any(isinstance(item, str) for item in document) else _number
    return tuple(check(item, None) for item in document)


def _by_name(document: Any, kind: Any) -> ByName[Any]:
    if not isinstance(document, Mapping):
        raise TypeError(f"{document!r} is not an object of names")
    (item,) = get_args(kind)
    return ByName(decoded({**own, "name": name}, item) for name, own in document.items())


def _without_name(item: Any) -> dict[str, Any]:
    own: dict[str, Any] = encoded(item)
    return {key: value for key, value in own.items() if key != "name"}


def _codec() -> Converter:
    made = Converter()
    made.register_unstructure_hook(np.ndarray, lambda x: x.tolist())
    made.register_unstructure_hook_func(
        lambda kind: get_origin(kind) is ByName or kind is ByName,
        lambda items: {item.name: _without_name(item) for item in items},
    )
    made.register_structure_hook_func(lambda kind: get_origin(kind) is ByName, _by_name)
    made.register_unstructure_hook_func(lambda kind: get_origin(kind) is np.ndarray, lambda x: x.tolist())
    made.register_structure_hook_func(
        lambda kind: get_origin(kind) is np.ndarray, lambda document, _: np.array(document, float)
    )
    made.register_structure_hook(float, _number)
    made.register_structure_hook(str, _text)
    made.register_structure_hook(tuple[float, ...] | tuple[str, ...], _all_alike)
    return made


_CODEC = _codec()
in_json(Quantity, sparse=("bound",))
