"""The vehicle's logs by MAVSDK's log_files plugin, with the interface of `download.LogSource`."""

from __future__ import annotations

import datetime
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rover_sweep.errors import LinkError
from rover_sweep.vehicle.events import LogProgress, LogSaved
from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.link.mavsdk_rider import TURN, MavsdkRider
from rover_sweep.vehicle.link.recorder import writing
from rover_sweep.vehicle.logs.download import LogEntry, refuse_download_if_armed

if TYPE_CHECKING:
    from mavsdk.plugins.log_files import LogFiles


@dataclass(frozen=True)
class MavsdkLogs:
    """Logs by MAVSDK, which restarts an interrupted download from the beginning."""

    link: Link

    def logs(self) -> tuple[LogEntry, ...]:
        """All logs, oldest first. The dates of MAVSDK become seconds since 1970."""
        refuse_download_if_armed(self.link)
        with MavsdkRider(self.link) as rider:
            return tuple(_entry(e) for e in _listed(rider, _plugin(rider)))

    def download(self, entry: LogEntry, path: Path) -> Iterator[LogProgress | LogSaved]:
        """Fetch one log into `path` (first as NAME.part); yields progress, then LogSaved."""
        from mavsdk.plugins.log_files import LogFilesResult

        refuse_download_if_armed(self.link)
        partial = path.with_name(path.name + ".part")
        began, steps = self.link.line.monotonic(), deque[tuple[Any, float]]()
        with MavsdkRider(self.link) as rider:
            files = _plugin(rider)
            wanted = next((e for e in _listed(rider, files) if e.id == entry.number), None)
            if wanted is None:
                raise LinkError(f"the vehicle has no log {entry.number}")
            with writing(path):
                partial.parent.mkdir(parents=True, exist_ok=True)
                partial.unlink(missing_ok=True)
            files.download_log_file_async(
                wanted, str(partial), lambda result, data, _: steps.append((result, data.progress))
            )
            while True:
                self.link.receive(TURN)
                while steps:
                    result, share = steps.popleft()
                    if result == LogFilesResult.NEXT:
                        yield LogProgress(entry.number, int(share * wanted.size_bytes), wanted.size_bytes)
                        continue
                    if result != LogFilesResult.SUCCESS:
                        raise LinkError(f"MAVSDK did not get log {entry.number} ({result.name.lower()})")
                    with writing(path):
                        partial.replace(path)
                    yield LogSaved(path, path.stat().st_size, self.link.line.monotonic() - began)
                    return


def _plugin(rider: MavsdkRider) -> LogFiles:
    from mavsdk.plugins.log_files import LogFiles

    return LogFiles(rider.system)


def _listed(rider: MavsdkRider, files: LogFiles) -> list[Any]:
    """The same MAVSDK instance must list and download: it only knows the entries that it listed."""
    from mavsdk.plugins.log_files import LogFilesError, LogFilesResult

    try:
        found: list[Any] = rider.call(files.get_entries)
    except LogFilesError as error:
        if LogFilesResult.NO_LOGFILES.name in str(error):
            return []
        raise LinkError(f"MAVSDK does not list the vehicle's logs ({error})") from error
    return sorted(found, key=lambda e: e.id)


def _entry(found: Any) -> LogEntry:
    date = found.date.decode() if isinstance(found.date, bytes) else str(found.date)
    try:
        seconds = int(datetime.datetime.fromisoformat(date).timestamp())
    except ValueError:
        seconds = 0
    return LogEntry(int(found.id), int(found.size_bytes), seconds)
