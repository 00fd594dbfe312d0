"""Converts .BIN, .tlog and .csv files to `Recording`s; the only room that knows ArduPilot's field names."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rover_sweep.logs.read import read_logs, read_runs

__all__ = ["read_logs", "read_runs"]


def __getattr__(name: str) -> Any:
    if name in __all__:
        from rover_sweep.logs import read

        return getattr(read, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
