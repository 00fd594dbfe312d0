"""Methods of results whose code lies in a room above: imported when called, so that no circle arises.

Data, spectra and models must load without matplotlib and pandas, yet `.plot()` belongs to them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any

from rover_sweep.errors import missing_extra


def drawing(address: str) -> Callable[..., Any]:
    """The function "module:name" of `rover_sweep.drawing`."""
    module, _, name = address.partition(":")
    found: Callable[..., Any] = getattr(import_module(f"rover_sweep.drawing.{module}"), name)
    return found


def data_frame(columns: Any, index: Any = None, index_name: str | None = None) -> Any:
    """A pandas.DataFrame of {column: values}; UsageError without pandas.

    index: values, or None to count the rows; index_name: its name.
    """
    frame = _pandas().DataFrame(columns, index=index)
    if index_name is not None:
        frame.index.name = index_name
    return frame


def keyed_frame(columns: Mapping[str, Any], keys: Mapping[str, Any]) -> Any:
    """A pandas.DataFrame of {column: values} with the index {name: values} of several levels."""
    return data_frame({**keys, **columns}).set_index(list(keys))


def joined_frames(frames: Mapping[str, Any], name: str) -> Any:
    """One pandas.DataFrame of several, with their keys as the outer index, of this name."""
    found = _pandas().concat(frames)
    found.index.names = [name, *found.index.names[1:]]
    return found


def _pandas() -> Any:
    try:
        return import_module("pandas")
    except ImportError:
        raise missing_extra("to_frame() needs pandas", "pandas") from None
