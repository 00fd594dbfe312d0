"""What `dry-run` and `run` share: drive a session before the user's eyes, then identify from it."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from rover_sweep.cli.views.display import PlainDisplay, display
from rover_sweep.cli.views.interruption import let_go_on_signals
from rover_sweep.cli.views.output import narration
from rover_sweep.errors import DataRefused, RoverSweepError
from rover_sweep.vehicle.events import Event, Interrupted, RunFinished, SessionFinished, StreamsSet

if TYPE_CHECKING:
    from rich.console import RenderableType

    from rover_sweep.data.recording import Recording
    from rover_sweep.data.vehicle_file import Vehicle
    from rover_sweep.identification.pipeline import Identification

Events = Generator[Event, None, None]
Answer = Callable[[PlainDisplay, Event], None]
_NOTHING = "nothing was recorded"


def driven(
    events: Events,
    folder: Path,
    *,
    talk: bool = False,
    go_on: bool = False,
    answer: Answer | None = None,
    logs: bool = True,
) -> SessionFinished:
    """Shows the events to the end of the session.

    logs: whether the vehicle's logs are fetched at its end. answer is called after each event was shown, and
    may ask the user. Ctrl-C during a run lets the rover go; go_on: and the session goes on to the logs.
    Otherwise it comes out, as errors do, after the rover was let go and the user was told what was kept.
    """
    console, finished, interrupted = narration(), list[RunFinished](), False
    granted = dict[str, float]()
    try:
        with let_go_on_signals(), display(console, talk) as shown:
            for event in _shown(events, shown, answer):
                if words := _telemetry(event, granted, logs):
                    shown.say(f"  {words}")
                finished += [event] if isinstance(event, RunFinished) else []
                if isinstance(event, SessionFinished):
                    return event
                if isinstance(event, Interrupted):
                    interrupted = True
                    if not go_on:
                        raise KeyboardInterrupt
    except (KeyboardInterrupt, RoverSweepError) as stop:
        events.close()
        if isinstance(stop, KeyboardInterrupt) and not interrupted:
            console.print("no run was under way: nothing moves", markup=False)
        kept = _kept(folder, finished)
        if kept != _NOTHING or isinstance(stop, KeyboardInterrupt):  # an error says itself what is lacking
            console.print(kept, markup=False, soft_wrap=True)
        raise
    raise AssertionError("a session ends with SessionFinished")


def _shown(events: Events, display: PlainDisplay, answer: Answer | None) -> Iterator[Event]:
    """The events, each shown; a Ctrl-C that comes meanwhile reaches the session, which lets the rover go."""
    caught: KeyboardInterrupt | None = None
    while True:
        try:
            event = events.throw(caught) if caught else next(events)
        except StopIteration:
            return
        caught = None
        try:
            display.show(event)
            if answer is not None:
                answer(display, event)
        except KeyboardInterrupt as stop:
            caught = stop
        yield event


def _telemetry(event: Event, granted: dict[str, float], logs: bool) -> str:
    """How the telemetry of a run came that is over. granted: Hz by message, learnt on the way."""
    from rover_sweep.vehicle.preflight.arrival import arrival_clock
    from rover_sweep.vehicle.preflight.telemetry_quality import telemetry_words

    if isinstance(event, StreamsSet):
        granted |= {stream.message: stream.hz for stream in event.streams}
    if not isinstance(event, RunFinished) or not event.completed:
        return ""
    return telemetry_words(event.quality, granted, arrival_clock(event.tlog, event.span), logs)


def _kept(folder: Path, finished: list[RunFinished]) -> str:
    """Which recordings are there, and which of them hold a whole run."""
    whole = {run.tlog.name for run in finished if run.completed}
    tlogs = [p.name for p in sorted(folder.glob("*.tlog")) if p.stem not in ("connect", "fetch")]
    told = [name if name in whole else f"{name} (no whole run)" for name in tlogs]
    told += [p.name for p in sorted(folder.glob("*.BIN"))]
    return f"kept in {folder}: {', '.join(told)}" if told else _NOTHING


def recordings(session: SessionFinished, vehicle: Vehicle) -> tuple[Recording, ...]:
    """The runs of a session that came to their end: out of the vehicle's logs, else out of the telemetry.

    DataRefused where none did.
    """
    from rover_sweep.api.read import Reading, load

    try:
        return load([str(session.folder)], vehicle, Reading())
    except DataRefused as refusal:
        raise DataRefused(f"{refusal}; {_kept(session.folder, list(session.runs))}") from refusal


def identified_session(
    session: SessionFinished,
    rover: tuple[Vehicle, Path],
    as_json: bool,
    verbose: bool,
    more: Callable[[Identification], RenderableType] | None = None,
) -> None:
    """Identifies from the whole runs of a session, verifies on its doublets, reports into its report/."""
    from rover_sweep.api.run_roles import divided
    from rover_sweep.cli.driving.show_identified import show_identified
    from rover_sweep.identification.grouping import Settings
    from rover_sweep.session.recording_choice import origin_words

    runs = recordings(session, rover[0])
    for words in origin_words(session.folder, runs):
        narration().print(words, markup=False, soft_wrap=True)
    sweeps, doublets = divided(runs)
    show_identified(sweeps, doublets, rover, Settings(), session.folder / "report", as_json, verbose, more)
