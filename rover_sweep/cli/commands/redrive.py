"""`rover-sweep redrive`: repeat a log's steering and speed in a simulation, recorded like a drive."""

from __future__ import annotations

import errno
import math
import queue
import shlex
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rover_sweep.cli.driving_options import SIMULATION, SimulationOptions
from rover_sweep.cli.options import FILE, POSITIVE, NumberRange, argument, option, options
from rover_sweep.cli.views.output import say_next
from rover_sweep.errors import UsageError

if TYPE_CHECKING:
    from rover_sweep.live.played_source import PlayedSource
    from rover_sweep.live.source import Update

_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS)


@click.command()
@options
def redrive(
    log: str = argument("LOG"),
    vehicle: str | None = option(
        "Vehicle file; its masses, lengths and steering replace those of the variant.", FILE
    ),
    simulation: SimulationOptions = SIMULATION,
    out: str = option("Recording to write (.BIN).", FILE, required=True),
) -> None:
    """Repeat LOG in a simulation: the same steering PWM at the same times, at the same speed.

    Writes a recording on LOG's clock that every command reads like LOG. Use it in
    `rover-sweep diagnose LOG --simulation OUT` to find where field and simulation differ. The plant
    takes about one second per drive; the firmware runs in real time.
    """
    import numpy as np

    from rover_sweep.cli.views.output import narration, results
    from rover_sweep.logs.read import read_logs, read_runs
    from rover_sweep.logs.readers.screening import screened
    from rover_sweep.redrive.recorded_course import (
        course_of,
        described,
        on_the_clock,
        refuse_instant,
        simulated_rover,
    )

    target, simulator = Path(out), simulation.simulator or "plant"
    if target.suffix.lower() != ".bin":
        raise UsageError(f"--out {out}: the recording is a DataFlash log; give a name that ends in .BIN")
    if target.exists():
        raise UsageError(f"--out {out} already exists; give another name")
    if not target.parent.is_dir():
        raise UsageError(f"--out {out}: there is no folder {target.parent}")
    parameters = simulated_rover(simulation.variant, vehicle)
    if simulator != "plant":
        refuse_instant(parameters, simulator)
    runs, logs = read_runs(log), read_logs(log)
    if len(logs) != 1:
        raise UsageError(f"{log} holds {len(logs)} logs; give a source with only one")
    course = course_of(screened(logs[0]))
    console = narration()
    console.print(f"{simulator}, {described(parameters, simulation.variant, vehicle)}", soft_wrap=True)
    with _complete_file(target) as made:
        if simulator == "plant":
            from sitl.redrive.open_loop import redrive as drive

            try:
                drive(course, on_the_clock(parameters, runs), made, simulation.seed)
            except ValueError as error:  # the rover overturns
                raise UsageError(str(error)) from error
        else:
            from rover_sweep.redrive.on_autopilot import drive_course

            for line in drive_course(course, parameters, made, simulator, simulation.binary, simulation.seed):
                console.print(line, soft_wrap=True)
    shown, simulated = results(), read_runs(str(target))  # the new one is read back from the file
    for run, again in zip(runs, simulated, strict=False):
        speed = run.manoeuvre("speed")
        off = again["speed"].on(speed.t) - speed.x
        shown.print(
            f"{run.name}: {run.span[1] - run.span[0]:.1f} s at {run.mean_speed:.2f} m/s; "
            f"simulated minus recorded speed: mean {np.mean(off):+.3f} m/s, "
            f"rms {np.sqrt(np.mean(off**2)):.3f} m/s",
            soft_wrap=True,
        )
    shown.print(f"{target}: {len(simulated)} run{'s' if len(simulated) != 1 else ''}", soft_wrap=True)
    given = shlex.join([log, "--simulation", str(target), "--vehicle", vehicle or "rover.toml"])
    say_next(f"rover-sweep diagnose {given} --out diagnosis")


@contextmanager
def _complete_file(target: Path) -> Iterator[Path]:
    """Yields the path to write; the target then gets the complete file or, with a UsageError, none."""
    from rover_sweep.files.documents import write_file

    try:
        with tempfile.TemporaryDirectory() as folder:
            yield Path(folder) / target.name
            data = (Path(folder) / target.name).read_bytes()
    except OSError as error:
        if error.errno not in _NO_ROOM:
            raise
        where = f"{target} cannot be written: {error.strerror} in {tempfile.gettempdir()}"
        raise UsageError(f"{where}; free space there, or set TMPDIR to another folder") from error
    write_file(target, data)


@click.command()
@options
def replay(
    log: str = argument("LOG", type=click.Path()),
    speed: float | None = option(
        "Playback speed, times real time. [default: 1 on the screen, unlimited as text]", POSITIVE, "X"
    ),
    start: float = option(
        "Start this many seconds into the recording.",
        NumberRange(0),
        "S",
        "--from",
        default=0.0,
        show_default=False,
    ),
    text: bool = option("Plain text (default when not in a terminal)."),
) -> None:
    """Play a .tlog or .BIN on the screen of `session`, with its runs and their verdicts.

    Finds runs steered by the applet and by hand. No vehicle is contacted.
    """
    from rover_sweep.cli.views.output import narration, results
    from rover_sweep.live.played_source import PlayedSource

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
