"""The interface of a recording that is played, .tlog or .BIN: its position, and the events on the way."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Protocol

from rover_sweep.errors import UsageError
from rover_sweep.live.played.runs import RunSpan
from rover_sweep.live.snapshot import Snapshot
from rover_sweep.logs.log import Log
from rover_sweep.vehicle.events import Event


class Track(Protocol):
    """Positions are s of the vehicle's clock from the start of the recording; a restart takes no time.

    length [s]; places: its runs; remarks: what has to be said of the recording; log: the first in it.
    """

    length: float
    places: tuple[RunSpan, ...]
    remarks: tuple[str, ...]
    log: Log

    def seek(self, at: float) -> None:
        """Go to a position; the state is as after playing up to it."""
        ...

    def play(self, at: float) -> Iterator[Event]:
        """Continue to a position, with the events on the way."""
        ...

    def snapshot(self) -> Snapshot:
        """The rover at the position."""
        ...


def open_track(path: Path) -> Track:
    """A .tlog or .BIN. UsageError for anything else, DataRefused for one that cannot be played."""
    if path.is_dir():
        raise UsageError(f"{path} is a folder; give the path of a .BIN or .tlog in it")
    if not path.is_file():
        raise UsageError(f"{path}: there is no such file; give the path of a .BIN or .tlog")
    match path.suffix.lower():
        case ".tlog":
            from rover_sweep.live.played.tlog_player import TlogTrack

            return TlogTrack(path)
        case ".bin":
            from rover_sweep.live.played.dataflash_player import FlashTrack

            return FlashTrack(path)
    raise UsageError(f"{path.name}: {path.suffix or 'no extension'} cannot be played; give a .BIN or .tlog")
