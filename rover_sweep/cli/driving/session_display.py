"""Show a session while it is driven (`dry-run`, `run`, `resume`), then identify from its runs."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Generator, Iterator
from pathlib import Path

from rover_sweep.api.read import Reading, divided, load_steered, why_not_fitted
from rover_sweep.api.speed import throttle_sweeps
from rover_sweep.cli.driving.shown_results import Rover, add_steering, show_identified, show_speed
from rover_sweep.cli.views.asking import let_go_on_signals
from rover_sweep.cli.views.display import PlainDisplay, display, interrupted_words
from rover_sweep.cli.views.output import narration
from rover_sweep.data.recording import Recording
from rover_sweep.data.vehicle_file import Vehicle
from rover_sweep.errors import DataRefused, RoverSweepError
from rover_sweep.identification.grouping import Settings
from rover_sweep.identification.pipeline import Identification
from rover_sweep.manoeuvre.sweep import ThrottleSweep
from rover_sweep.report.document import Table
from rover_sweep.session.folder import read_folder
from rover_sweep.session.session import origin_words
from rover_sweep.system import hold_stops, one_stop
from rover_sweep.vehicle.events import Event, Interrupted, Notice, RunFinished, SessionFinished, StreamsSet
from rover_sweep.vehicle.preflight.rates import telemetry_words
from rover_sweep.vehicle.preflight.readiness import arrival_clock
from rover_sweep.vehicle.run.controls import MAY_BE_ARMED

Events = Generator[Event, None, None]
AfterEvent = Callable[[PlainDisplay, Event], None]
_NOTHING = "nothing was recorded"


def show_session(
    events: Events,
    folder: Path,
    *,
    talk: bool = False,
    go_on: bool = False,
    answer: AfterEvent | None = None,
    logs: bool = True,
) -> SessionFinished:
    """Show the events of a session until it has finished.

    logs: whether the vehicle's logs are downloaded at the end. answer is called after each event is shown,
    and may ask the user. Ctrl-C during a run releases the rover; with go_on the session then continues to
    the logs. Otherwise KeyboardInterrupt, like any error, is raised after the rover was released and the
    recordings that exist were listed.
    """
    console, finished, unshown = narration(), list[RunFinished](), list[Interrupted]()
    interrupted, granted = False, dict[str, float]()
    with let_go_on_signals():
        try:
            with display(console, talk) as shown:
                for event in _shown(events, shown, answer, unshown):
                    if words := _telemetry(event, granted, logs):
                        shown.say(f"  {words}")
                    finished += [event] if isinstance(event, RunFinished) else []
                    if isinstance(event, SessionFinished):
                        return event
                    if isinstance(event, Interrupted):
                        interrupted = True
                        if not go_on:
                            raise KeyboardInterrupt
        except BaseException as stop:
            with one_stop():
                hold_stops()
                _ended(events, stop, unshown)
                for words in _last_words(stop, interrupted, unshown, folder, finished):
                    console.print(words, soft_wrap=True)
            raise
    raise AssertionError("a session ends with SessionFinished")


def _ended(events: Events, stop: BaseException, unshown: list[Interrupted]) -> None:
    """End the session because of `stop`. In a run it releases the rover first: its last event is added to
    `unshown`, or what it could not release to the notes of `stop`."""
    try:
        event = events.throw(stop)
        unshown += [event] if isinstance(event, Interrupted) else []
        events.close()
    except StopIteration:
        return
    except BaseException as error:
        for note in getattr(error, "__notes__", ()) if error is not stop else ():
            stop.add_note(note)


def _last_words(
    stop: BaseException,
    interrupted: bool,
    unshown: list[Interrupted],
    folder: Path,
    finished: list[RunFinished],
) -> Iterator[str]:
    """Sentences on the rover and on the recordings, of a session that ends because of `stop`."""
    yield from map(interrupted_words, unshown)
    if not isinstance(stop, KeyboardInterrupt | RoverSweepError):
        return
    kept = _kept(folder, finished)
    if isinstance(stop, KeyboardInterrupt):
        if not (interrupted or unshown):
            moves = MAY_BE_ARMED if read_folder(folder).left_armed else "this program moves nothing"
            yield f"no run was in progress: {moves[0].lower()}{moves[1:]}"
        yield kept
    elif kept != _NOTHING:  # an error explains itself
        yield kept


def _shown(
    events: Events, display: PlainDisplay, answer: AfterEvent | None, unshown: list[Interrupted]
) -> Iterator[Event]:
    """Show and yield each event; a Ctrl-C meanwhile is thrown into the session, which releases the rover.

    unshown: gets the end of a run by Ctrl-C, and loses it when it is on the screen.
    """
    caught: KeyboardInterrupt | None = None
    while True:
        try:
            event = events.throw(caught) if caught else next(events)
        except StopIteration:
            return
        caught = None
        unshown += [event] if isinstance(event, Interrupted) else []
        try:
            display.show(event)
            if answer is not None:
                answer(display, event)
        except KeyboardInterrupt as stop:
            caught = stop
            if isinstance(event, Notice | Interrupted):  # a warning, of which half may be on the screen
                display.show(event)
        unshown.clear()
        yield event


def _telemetry(event: Event, granted: dict[str, float], logs: bool) -> str:
    """Sentence on the telemetry quality of a finished run, else "". granted: Hz by message, updated."""
    if isinstance(event, StreamsSet):
        granted |= {stream.message: stream.hz for stream in event.streams}
    if not isinstance(event, RunFinished) or not event.completed:
        return ""
    return telemetry_words(event.quality, granted, arrival_clock(event.tlog, event.span), logs)


def _kept(folder: Path, finished: list[RunFinished]) -> str:
    """A sentence that lists the recordings, and marks those without a complete run."""
    whole = {run.tlog.name for run in finished if run.completed}
    whole |= {run.tlog for run in read_folder(folder).runs if run.state == "done"}
    tlogs = [p.name for p in sorted(folder.glob("*.tlog")) if p.stem not in ("connect", "fetch")]
    files = [name if name in whole else f"{name} (no complete run)" for name in tlogs]
    files += [p.name for p in sorted(folder.glob("*.BIN"))]
    return f"kept in {folder}: {', '.join(files)}" if files else _NOTHING


def complete_runs(session: SessionFinished, vehicle: Vehicle) -> tuple[Recording, ...]:
    """The complete runs of a session, from the vehicle's logs, else from the telemetry.

    DataRefused if there is none.
    """
    try:
        return load_steered([str(session.folder)], vehicle, Reading())
    except DataRefused as refusal:
        raise DataRefused(f"{refusal}; {_kept(session.folder, list(session.runs))}") from refusal


def identify_session(
    session: SessionFinished,
    rover: Rover,
    as_json: bool,
    full: bool,
    more: Callable[[Identification], Table | None] | None = None,
) -> None:
    """Identify from the complete runs of a session, verify on its doublets, write its report/.

    Without a sweep there is nothing to identify: the recordings are kept, and a sentence says so. Throttle
    sweeps become speed.html and speed.json in it; as_json prints the latter only if there are no other runs.
    """
    report = session.folder / "report"
    swept = throttle_sweeps([str(session.folder)])
    speed = None
    if swept:
        alone = all(isinstance(run.manoeuvre, ThrottleSweep) for run in read_folder(session.folder).runs)
        speed = show_speed(swept, report, as_json, alone)
        if alone:
            return
    runs = complete_runs(session, rover[0])
    for words in origin_words(session.folder, runs):
        narration().print(words, soft_wrap=True)
    if not as_json and (why := why_not_fitted(runs)):
        narration().print(f"nothing is identified: {why}; {_kept(session.folder, list(session.runs))}")
        return
    sweeps, doublets = divided(runs)
    settings, again = Settings(bootstrap=200), shlex.quote(str(session.folder))
    show_identified(sweeps, doublets, rover, settings, report, as_json, full, more, again=again)
    add_steering(speed, report)
