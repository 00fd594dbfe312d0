"""`rover-sweep replay`: play a recording on the screen that `session` uses for a vehicle."""

from __future__ import annotations

import math
import queue
from typing import TYPE_CHECKING

import click

from rover_sweep.cli.types.options import NumberRange

if TYPE_CHECKING:
    from rover_sweep.live.played.played_source import PlayedSource
    from rover_sweep.live.source import Update


@click.command()
@click.argument("log", type=click.Path(), metavar="LOG")
@click.option(
    "--speed",
    type=NumberRange(0, min_open=True),
    metavar="X",
    help="Playback speed, times real time. [default: 1 on the screen, unlimited as text]",
)
@click.option(
    "--from",
    "start",
    type=NumberRange(0),
    default=0.0,
    metavar="S",
    help="Start this many seconds into the recording.",
)
@click.option("--text", is_flag=True, help="Plain text (default when not in a terminal).")
def replay(log: str, speed: float | None, start: float, text: bool) -> None:
    """Play a .tlog or .BIN on the screen of `session`, with its runs and their verdicts.

    Finds runs steered by the applet and by hand. No vehicle is contacted.
    """
    from rover_sweep.cli.views.output import narration, results
    from rover_sweep.live.played.played_source import PlayedSource

    as_text = text or not (narration().is_terminal and results().is_terminal)
    source = PlayedSource(log, speed or (math.inf if as_text else 1.0), start)
    if as_text:
        as_lines(source)
        return
    from rover_sweep.tui.app import show

    show(source, view="run")


def as_lines(source: PlayedSource) -> None:
    """Play the recording to its end as plain text, one line per event."""
    from rover_sweep.cli.views.display import PlainDisplay
    from rover_sweep.cli.views.output import results
    from rover_sweep.live.source import Judged, Played
    from rover_sweep.vehicle import events as e

    messages: queue.SimpleQueue[Update] = queue.SimpleQueue()
    shown = PlainDisplay(results(), talk=True)
    runs = len(source.track.places)
    many = {0: "no run", 1: "1 run"}.get(runs, f"{runs} runs")
    shown.say(f"{source.path.name}: {source.track.length:.1f} s, {many}")
    source.start(messages.put)
    try:
        while True:
            match messages.get():
                case Played(t, length):
                    if t >= length:
                        return
                case e.RunFinished(completed=True):
                    pass  # shown with its verdict, which comes next
                case Judged(verdict):
                    shown.say(f"  {verdict.run}: {verdict.sentence}")
                    for remark in verdict.remarks:
                        shown.say(f"    {remark}")
                case e.Connected(vehicle=vehicle):
                    shown.say(vehicle.firmware)
                case e.Notice() | e.Said() | e.RunStarted() | e.RunFinished() as event:
                    shown.show(event)
    finally:
        source.close()
