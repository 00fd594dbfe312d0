"""From which file each run of a session is identified, and why."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from rover_sweep.data.recording import Recording
from rover_sweep.logs.readers.dropped import dropped_messages
from rover_sweep.session.folder import read_folder


def origin_words(folder: Path, runs: Sequence[Recording]) -> Iterator[str]:
    """A sentence for each file that `session_runs` chose: the vehicle's log if one holds the run completely,
    else the telemetry."""
    fetched = [log.file for log in read_folder(folder).logs]
    for file in dict.fromkeys(run.sources[0][0] for run in runs):
        mine = [run for run in runs if run.sources[0][0] == file]
        steering, turning = mine[0]["pwm" if "pwm" in mine[0] else "delta"], mine[0]["r"]
        rates = (
            f"steering ({steering.source}) at {steering.rate:.0f} Hz, "
            f"gyro ({turning.source}) at {turning.rate:.0f} Hz"
        )
        names = ", ".join(run.name for run in mine)
        yield f"{names}: identified from {file}, {rates}; {_why(folder, file, fetched)}"


def _why(folder: Path, file: str, fetched: Sequence[str]) -> str:
    if file in fetched:
        return f"the rover's log holds the whole run on one clock, {_dropped(folder / file)}"
    if fetched:
        return f"not from {', '.join(fetched)}, where the run is incomplete"
    return "the rover's log was not fetched"


def _dropped(log: Path) -> str:
    lost = dropped_messages(log)
    if lost is None:
        return "and does not report whether messages were dropped"
    return f"{lost or 'no'} {'message' if lost == 1 else 'messages'} dropped (DSF.Dp)"
