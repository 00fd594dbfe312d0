"""Reads the runs of a session's folder from the vehicle's logs, or from the tlogs if the logs lack them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

from rover_sweep.data.recording import Note, Recording
from rover_sweep.errors import DataRefused, UsageError
from rover_sweep.logs import read_runs
from rover_sweep.manoeuvre.sweep import ThrottleSweep
from rover_sweep.session.content import Content, DrivenRun
from rover_sweep.session.folder import DESCRIPTION, read_folder

_END = 2.0  # s: tolerance between the end of a run and its end in the log


def session_runs(folder: Path, filters: Mapping[str, float] | None = None) -> tuple[Recording, ...]:
    """The completed runs on the steering, in the order driven, with their planned names.

    filters: as in `read_runs`. Notes on the first run name the runs left out. DataRefused if none is left.
    """
    content = read_folder(folder)
    steered = [run for run in content.runs if not isinstance(run.manoeuvre, ThrottleSweep)]
    left_out = [f"{run.label} was left out: {run.reason}" for run in steered if run.state != "done"]
    swept = [run.label for run in content.runs if run not in steered and run.state == "done"]

    @cache
    def runs_of(file: str) -> tuple[Recording, ...]:
        return read_runs(str(folder / file), filters=filters)

    found: list[Recording] = []
    for run in (run for run in steered if run.state == "done"):
        for file in _files(folder, content, run):
            try:
                found.append(replace(_own(runs_of(file), run), name=run.label))
                break
            except DataRefused as refusal:
                why = str(refusal)
        else:
            left_out.append(f"{run.label} was left out: {why}")
    if not found and not (folder / DESCRIPTION).is_file():  # logs in a folder, and no session of ours
        raise UsageError(f"{folder} is a folder; give the path of a .BIN, .tlog or .csv in it")
    if not found and swept and not left_out:
        raise DataRefused(
            f"{folder.name} has throttle sweeps only ({', '.join(swept)}); they are identified from the "
            "vehicle's log: fetch its .BIN"
        )
    if not found:
        raise DataRefused(
            f"no run in {folder.name} was completed ({'; '.join(left_out) or 'none was driven'})"
        )
    notes = tuple(Note("warning", words) for words in left_out)
    return (replace(found[0], notes=(*found[0].notes, *notes)), *found[1:])


def _files(folder: Path, content: Content, run: DrivenRun) -> Sequence[str]:
    """The files that may hold a run, the best first."""
    logs = [log.file for log in content.logs if run.label in log.runs and (folder / log.file).is_file()]
    return (*logs, run.tlog)


def _own(found: Sequence[Recording], run: DrivenRun) -> Recording:
    """The recording of that run among those of a file. DataRefused if there is none."""
    if run.span is None:
        raise DataRefused(f"{run.label} has no known time")
    start, end = run.span
    shared = [min(r.span[1], end) - max(r.span[0], start) for r in found]
    if not shared or max(shared) <= 0:
        raise DataRefused(f"the recording does not contain {run.label}")
    return found[shared.index(max(shared))]


def held(log: Path, runs: Sequence[DrivenRun]) -> tuple[str, ...]:
    """Labels of the runs that the DataFlash log holds completely, by the applet's messages in it."""
    from rover_sweep.logs.read import read_logs
    from rover_sweep.logs.runs.applet import applet_runs

    there = [
        (int(rows.run[0]), float(rows.t[0]), float(rows.t[-1]))
        for part in read_logs(str(log))
        for applet in (part.applet, part.throttle_applet)
        if applet is not None
        for rows in applet_runs(applet)
    ]
    return tuple(run.label for run in runs if any(_same(run, *rows) for rows in there))


def _same(run: DrivenRun, number: int, start: float, end: float) -> bool:
    """Whether a run in a log is `run`. The applet's counter continues over boots, so it distinguishes runs at
    the same time after boot."""
    if run.state != "done" or run.span is None or (run.number and number != run.number):
        return False
    return start < run.span[1] and run.span[1] - _END < end < run.span[1] + _END
