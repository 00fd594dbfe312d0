"""A session's folder on disk: opened, read, and kept up to date after every change."""

from __future__ import annotations

import contextlib
import json
import math
import os
import threading
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from rover_sweep._version import __version__
from rover_sweep.errors import UsageError
from rover_sweep.files.documents import printable, read_json
from rover_sweep.manoeuvre.sweep import configured_manoeuvre
from rover_sweep.session.content import (
    FORMAT,
    TEXT,
    Content,
    DrivenRun,
    Entry,
    FetchedLog,
    SessionRun,
    State,
    from_json,
    to_json,
)
from rover_sweep.system import hold_folder
from rover_sweep.vehicle.link.recorded_transport import writing
from rover_sweep.vehicle.run.follow import STOPPED_BY_APPLET, STOPPED_STATE, outcome_told

# The outcome of a run from its tlog alone, for a run during which the program was killed.


def outcome_of(path: Path) -> DrivenRun | None:
    """The run in a tlog with its outcome, never "begun"; None if the applet did nothing in it.

    Only the part after the vehicle's last boot counts, because a reboot ends a run.
    """
    from rover_sweep.logs.readers.tlog import open_tlog
    from rover_sweep.logs.readers.vehicle_clock import CLOCKS, sessions

    wanted = frozenset((*CLOCKS, "NAMED_VALUE_FLOAT", "STATUSTEXT", "PARAM_VALUE"))
    boots = list(sessions(open_tlog(path, wanted).messages))
    if not boots or "NAMED_VALUE_FLOAT" not in (last := boots[-1]).messages:
        return None
    rows, times = last.messages["NAMED_VALUE_FLOAT"].rows, last.seconds("NAMED_VALUE_FLOAT").tolist()
    named = [
        (t, name, int(value))
        for t, name, value in zip(times, rows["name"].tolist(), rows["value"].tolist(), strict=True)
        if math.isfinite(value)
    ]
    states = [(t, value) for t, name, value in named if name == b"SWP_ST"]
    start = next((t for t, state in states if state > 0), None)
    if start is None:
        return None
    numbers = [value for _, name, value in named if name == b"SWP_RUN"]
    # float32: 0.3, not 0.30000001
    values = {name: float(f"{value:.7g}") for name, value in last.parameters().items()}
    texts = [(t, printable(text)) for t, text in last.texts() if t >= start]
    state, reason, end, number = _outcome(texts, states, start, numbers[-1] if numbers else 0)
    return DrivenRun(path.stem, path.name, configured_manoeuvre(values), state, reason, (start, end), number)


def _outcome(
    texts: list[tuple[float, str]], states: list[tuple[float, int]], start: float, number: int
) -> tuple[State, str, float, int]:
    """(state, reason, end [s], run counter) by the applet's last status text, else by its last state."""
    end, state = states[-1]
    for t, text in reversed(texts):
        if told := outcome_told(text):
            return "done" if told[1] else "stopped", told[2], max(t, end), told[0]
    if state == STOPPED_STATE:
        return "stopped", STOPPED_BY_APPLET, end, number
    return "cut", f"the recording ends {end - start:.0f} s into the run", end, number


# A lock, so that only one program at a time uses a session's folder; the end of the program releases it.


class FolderLock:
    """Held until `close`. UsageError if another program holds it; no lock on systems without them."""

    def __init__(self, folder: Path) -> None:
        try:
            self._held = hold_folder(folder)
        except BlockingIOError:
            raise UsageError(f"another rover-sweep uses {folder}; end it, or give another folder") from None

    def close(self) -> None:
        """Release the lock; may be repeated."""
        held, self._held = self._held, -1
        if held >= 0:
            os.close(held)


DESCRIPTION, VEHICLE_FILE = "session.json", "rover.toml"
_NO_RUNS = ("connect", "fetch")  # tlogs recorded between the runs


class Session:
    """A session's folder during driving. Thread-safe; only one program at a time may use it.

    folder; content: the present content of session.json, a frozen value.
    """

    def __init__(self, folder: Path, content: Content) -> None:
        self.folder, self.content = folder, content
        self._lock = threading.RLock()
        self._folder_lock: FolderLock | None = None

    @classmethod
    def open(cls, folder: Path) -> Session:
        """Continue the session in `folder`, or begin one; finds runs that a kill interrupted.

        UsageError if the folder cannot be written, if its session.json is damaged, or if another program uses
        it; `close` releases it, and so does the end of the program.
        """
        with writing(folder):
            folder.mkdir(parents=True, exist_ok=True)
        lock = FolderLock(folder)
        try:
            session = cls(folder, read_folder(folder))
            session._folder_lock = lock
            session._write()
        except BaseException:
            lock.close()
            raise
        return session

    def close(self) -> None:
        """Release the folder for others; may be repeated."""
        if self._folder_lock is not None:
            self._folder_lock.close()

    @property
    def vehicle_file(self) -> Path | None:
        """The copy of the vehicle file, None if there is none."""
        path = self.folder / VEHICLE_FILE
        return path if path.is_file() else None

    @property
    def to_drive(self) -> tuple[SessionRun, ...]:
        """The planned runs not completed yet."""
        return self.content.to_drive

    def keep_vehicle_file(self, path: Path) -> None:
        """Copy the vehicle file into the folder; replaces an older copy."""
        target = self.folder / VEHICLE_FILE
        text = path.read_bytes()
        if path.resolve() != target.resolve():
            _replace(target, text)

    def tlog(self, name: str) -> Path:
        """An unused path for a new tlog, as NAME.tlog or NAME-2.tlog."""
        known = {run.tlog for run in self.content.runs}
        path, number = self.folder / f"{name}.tlog", 2
        while path.exists() or path.name in known:
            path, number = self.folder / f"{name}-{number}.tlog", number + 1
        return path

    def between(self) -> Path:
        """The tlog between the runs; it is appended to."""
        return self.folder / "connect.tlog"

    # ---- changes, each on disk before it returns -------------------------------------------------

    def plan(self, runs: tuple[SessionRun, ...]) -> None:
        """Replace the planned runs. The driven runs stay."""
        self._change(plan=tuple(runs))

    def on(self, vehicle: Mapping[str, Any]) -> None:
        """Set the vehicle. UsageError if the session was begun on another."""
        known = self.content.vehicle.get("uid")
        if self.content.runs and known and vehicle.get("uid") != known:
            raise UsageError(
                f"{self.folder.name} was begun on another rover (autopilot {known:x}, this one is "
                f"{vehicle.get('uid', 0):x}); give a new folder for this one"
            )
        self._change(vehicle=dict(vehicle))

    def set(self, settings: Mapping[str, Any], parameters: Mapping[str, float] | None = None) -> None:
        """Set the settings of the runs; parameters: those set on the vehicle, None: as before."""
        kept = self.content.parameters if parameters is None else parameters
        if (self.content.settings, self.content.parameters) != (settings, kept):
            self._change(settings=dict(settings), parameters=dict(kept))

    def logs_before(self, listed: tuple[tuple[int, int, int], ...]) -> None:
        """Set the vehicle's logs that are older than the session; only the first call counts."""
        if self.content.logs_before is None:
            self._change(logs_before=tuple(listed))

    def begun(self, planned: SessionRun, tlog: Path, arming: bool) -> None:
        """A run starts, recorded into `tlog`. arming: this program arms the rover for it."""
        run = DrivenRun(planned.name, tlog.name, planned.manoeuvre, "begun", left_armed=arming)
        self._change_runs((*self.content.runs, run))

    def ended(self, tlog: Path, state: State, reason: str, left_armed: bool, **known: Any) -> None:
        """The run recorded into `tlog` is over. known: its span, number and quality."""
        self._update(tlog.name, state=state, reason=reason, left_armed=left_armed, **known)

    def judged(self, tlog: Path, verdict: Mapping[str, Any]) -> None:
        """Store the verdict on a run; paths in it become file names, so that the folder can be moved."""
        text = json.dumps(dict(verdict), default=lambda x: x.name if isinstance(x, Path) else str(x))
        self._update(tlog.name, verdict=json.loads(text))

    def fetched(self, log: FetchedLog) -> None:
        """Add a fetched log; replaces an earlier entry of the same file."""
        with self._lock:
            others = tuple(known for known in self.content.logs if known.file != log.file)
            self._change(logs=(*others, log))

    def _update(self, tlog: str, **values: Any) -> None:
        with self._lock:
            self._change_runs(
                tuple(replace(run, **values) if run.tlog == tlog else run for run in self.content.runs)
            )

    def _change_runs(self, runs: tuple[DrivenRun, ...]) -> None:
        self._change(runs=runs)

    def _change(self, **values: Any) -> None:
        with self._lock:
            self.content = replace(self.content, **values)
            self._write()

    def _write(self) -> None:
        text = json.dumps({"rover_sweep": __version__} | to_json(self.content), indent=2, default=str) + "\n"
        _replace(self.folder / DESCRIPTION, text.encode())


def _replace(path: Path, data: bytes) -> None:
    """Replace a file as a whole, or not at all if interrupted."""
    partial = path.with_name(path.name + ".part")
    with writing(path):
        with partial.open("wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        partial.replace(path)


def is_session(folder: Path) -> bool:
    """Whether a folder holds a session, or the tlogs of one."""
    return folder.is_dir() and ((folder / DESCRIPTION).is_file() or any(folder.glob("*.tlog")))


def without_run(tlog: Path) -> str:
    """For a session's tlog in which the applet did nothing: a sentence that lists those with a complete run.

    "" for any other file, or if no run is complete.
    """
    folder = tlog.parent
    if tlog.suffix != ".tlog" or not (folder / DESCRIPTION).is_file() or not tlog.is_file():
        return ""
    with contextlib.suppress(UsageError):  # a damaged session.json
        whole = [run.tlog for run in read_folder(folder).runs if run.state == "done"]
        if whole and tlog.name not in whole and outcome_of(tlog) is None:
            have = "have one each: give one of them" if len(whole) > 1 else "has one: give it"
            return f"there is no run in {tlog.name}; {', '.join(whole)} {have}, or the folder {folder}"
    return ""


def kept_vehicle_file(sources: Sequence[str]) -> Path | None:
    """The vehicle file in the sessions among the sources; UsageError if they differ."""
    kept = [path for source in sources if (path := Path(source) / VEHICLE_FILE).is_file()]
    if len({path.read_bytes() for path in kept}) > 1:
        raise UsageError(
            f"the sessions have different vehicle files, {kept[0]} and others; choose one with --vehicle FILE"
        )
    return kept[0] if kept else None


def read_folder(folder: Path) -> Content:
    """Read the folder; changes nothing. The tlog gives the outcome of a run that did not end properly, and of
    a run that is missing in session.json. UsageError for a damaged session.json."""
    said = _said(folder)
    runs = [_with_outcome(folder, run) if run.state == "begun" else run for run in said.runs]
    known = {run.tlog for run in runs}
    for path in sorted(folder.glob("*.tlog"), key=lambda p: p.stat().st_mtime):
        if path.name not in known and path.stem.rstrip("-0123456789") not in _NO_RUNS:
            runs += [run] if (run := outcome_of(path)) else []
    return replace(said, runs=tuple(runs))


def _said(folder: Path) -> Content:
    path = folder / DESCRIPTION
    try:
        data = read_json(path.read_text(encoding="utf-8"))
        written = Entry(data).get("format", TEXT)
        if written == "rover-sweep session 1":  # older sessions cannot be continued
            return Content()
        if written != FORMAT:
            raise UsageError(f"{path} was written by another version ({written}); update this rover-sweep")
        return from_json(data)
    except FileNotFoundError:
        return Content()
    except OSError as error:
        raise UsageError(f"{path} cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise UsageError(
            f"{path} is damaged ({error}); correct it, or move it away: the runs are then found from their "
            ".tlog"
        ) from error


def _with_outcome(folder: Path, run: DrivenRun) -> DrivenRun:
    """A run whose end is not in session.json, with the outcome from its tlog."""
    path = folder / run.tlog
    found = outcome_of(path) if path.is_file() else None
    if found is None:
        return replace(run, state="cut", reason="the program ended before the run began")
    return replace(run, state=found.state, reason=found.reason, span=found.span, number=found.number)
