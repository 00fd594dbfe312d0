"""`rover-sweep dry-run`: the whole job on a simulated rover, from switch 6 to three models and a report."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rover_sweep.errors import UsageError

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress, TaskID

    from rover_sweep.identify.recording import Recording
    from rover_sweep.vehicle.dry_run import DryRun
    from rover_sweep.vehicle.events import Event, RunFinished
    from rover_sweep.vehicle_file import Vehicle


@click.command(name="dry-run")
@click.option("--out", type=click.Path(file_okay=False), default="dry-run", show_default=True, metavar="DIR",
              help="Folder for recordings and report; a used one is kept and added to.")  # fmt: skip
@click.option("--vehicle", "simulator", default="embedded", show_default=True,
              type=click.Choice(("embedded", "ardurover")),
              help="The embedded rover, or the real firmware in SITL before the same physics.")  # fmt: skip
@click.option("--ardurover", type=click.Path(dir_okay=False), metavar="FILE",
              help="The ArduRover SITL program (else $ROVER_SWEEP_ARDUROVER, else the PATH).")  # fmt: skip
@click.option("--connect", metavar="URL",
              help="A vehicle that runs already: tcp:HOST:PORT, udp:HOST:PORT or a serial port.")  # fmt: skip
@click.option("--arm-and-drive", is_flag=True,
              help="With --connect: let this program arm and drive that vehicle.")  # fmt: skip
@click.option("--rover-file", type=click.Path(dir_okay=False), metavar="FILE",
              help="rover.toml of the vehicle behind --connect.")  # fmt: skip
@click.option("--variant", default="nominal", show_default=True, metavar="NAME|FILE",
              help="Physics of the simulated rover.")  # fmt: skip
@click.option("--amplitude", type=click.FloatRange(0, min_open=True), default=120.0, show_default=True,
              metavar="US", help="Amplitude of the first sweep; the second has twice that.")  # fmt: skip
@click.option("--wmin", type=float, default=0.3, show_default=True, metavar="RAD/S")
@click.option("--wmax", type=float, default=25.0, show_default=True, metavar="RAD/S")
@click.option("--trec", type=float, default=55.0, show_default=True, metavar="S")
@click.option("--seed", type=int, default=1, show_default=True, help="Of noise and road.")
@click.option("--json", "as_json", is_flag=True, help="identification.json on stdout as well.")
def dry_run(
    out: str, simulator: str, ardurover: str | None, connect: str | None, arm_and_drive: bool,
    rover_file: str | None, variant: str, amplitude: float, wmin: float, wmax: float, trec: float, seed: int,
    as_json: bool,
) -> None:  # fmt: skip
    """Do the whole job on a simulated rover: no hardware, about half a minute.

    Starts the embedded rover, talks MAVLink to it over a loopback socket, uploads the sweep, arms,
    throws switch 6, records, judges the coherence after each run, drives a sweep at two amplitudes and
    a doublet, identifies the bicycle, roll-yaw and lumped models, verifies them on the doublet and
    writes a report.
    """
    from rich.console import Console

    from rover_sweep.vehicle.dry_run import DryRun

    if connect and not rover_file:
        raise UsageError("--connect needs --rover-file: the masses and lengths of that vehicle")
    settings = DryRun(
        sweeps=tuple(_sweep(factor * amplitude, wmin, wmax, trec) for factor in (1, 2)),
        simulator="ardurover" if simulator == "ardurover" else "embedded",
        ardurover=Path(ardurover) if ardurover else None,
        variant=variant,
        seed=seed,
        url=connect,
        consent=arm_and_drive,
    )
    console, folder = Console(stderr=True), Path(out)
    vehicle, vehicle_file = _vehicle(settings, folder, rover_file)
    logs = _driven(settings, folder, console)
    _identified(logs, vehicle, vehicle_file, folder, as_json)


def _sweep(amplitude: float, wmin: float, wmax: float, trec: float) -> Any:
    from rover_sweep.identify.sweep import Sweep

    try:
        return Sweep(amplitude=amplitude, w_min=wmin, w_max=wmax, t_rec=trec)
    except ValueError as error:
        raise UsageError(str(error)) from error


def _vehicle(settings: DryRun, folder: Path, rover_file: str | None) -> tuple[Vehicle, Path]:
    """The rover's numbers as its owner would have measured them; a simulated rover gets a rover.toml."""
    from rover_sweep.vehicle_file import load

    if rover_file:
        return load(rover_file), Path(rover_file)
    from sitl.parameters import load_variant
    from sitl.rover_file import rover_file as written

    try:
        text = written(load_variant(settings.variant), str(settings.variant))
    except ValueError as error:
        raise UsageError(str(error)) from error
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "rover.toml"
    path.write_text(text)
    return load(path), path


def _driven(settings: DryRun, folder: Path, console: Console) -> tuple[Path, ...]:
    """Drives everything with a progress bar a run; returns the vehicle's logs."""
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

    from rover_sweep.vehicle.dry_run import dry_run as drive
    from rover_sweep.vehicle.events import SessionFinished

    columns = (TextColumn("{task.description:<34}"), BarColumn(), TaskProgressColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console) as progress:
        display = _Display(progress)
        for event in drive(settings, folder):
            display.show(event)
            if isinstance(event, SessionFinished):
                return event.logs
    raise AssertionError("a session ends with SessionFinished")


class _Display:
    """Turns events into bars and lines."""

    def __init__(self, progress: Progress) -> None:
        self.progress = progress
        self.bar: TaskID = progress.add_task("starting the rover", total=None)
        self.fetching: TaskID | None = None
        self.length, self.start = 0.0, 0.0

    def show(self, event: Event) -> None:
        """One event."""
        from rover_sweep.vehicle import events as e

        match event:
            case e.Connected():
                self._finish(f"connected to {event.vehicle.firmware}")
            case e.Notice():
                self.say(event.text, "yellow" if event.level == "warning" else "")
            case e.Rebooting():
                self.say(f"rebooting the rover, for {', '.join(event.because)}")
            case e.RunStarted():
                self._finish("")
                self.length, self.start = event.manoeuvre.duration, 0.0
                what = f"{event.name}: {event.manoeuvre.kind}, +-{event.manoeuvre.amplitude:g} us"
                self.bar = self.progress.add_task(what, total=self.length)
            case e.StateChanged() if event.state == 3:
                self.start = event.t
            case e.Sample() if self.start:
                self.progress.update(self.bar, completed=min(event.t - self.start, self.length))
            case e.RunFinished():
                self._run_finished(event)
            case e.LogProgress():
                self._fetching(event.number, event.done, event.total)
            case _:
                pass

    def say(self, text: str, style: str = "") -> None:
        """A line above the bars."""
        self.progress.console.print(text, style=style or None, highlight=False, markup=False)

    def _finish(self, description: str) -> None:
        task = next((t for t in self.progress.tasks if t.id == self.bar), None)
        if task is not None and task.total is None:
            self.progress.update(self.bar, total=1, completed=1, description=description or task.description)

    def _run_finished(self, event: RunFinished) -> None:
        if not event.completed:
            self.say(f"{event.name} did not run to its end: {event.reason}", "bold red")
            return
        self.progress.update(self.bar, completed=self.length)
        if verdict := _coherence(event):
            self.say(f"  {event.name}: {verdict}")

    def _fetching(self, number: int, done: int, total: int) -> None:
        if self.fetching is None:
            self.fetching = self.progress.add_task("fetching the rover's log", total=total)
        self.progress.update(self.fetching, completed=done, total=total, description=f"fetching log {number}")


def _coherence(event: RunFinished) -> str | None:
    """The verdict on a run from its telemetry, None for a manoeuvre that coherence does not judge."""
    from rover_sweep.identify.quality import assess
    from rover_sweep.logs import read_runs

    runs = [r for r in read_runs(str(event.tlog)) if r.span[0] < event.span[1] and r.span[1] > event.span[0]]
    return assess(runs[-1]).sentence if runs and runs[-1].kind == "sweep" else None


def _identified(
    logs: tuple[Path, ...], vehicle: Vehicle, vehicle_file: Path, folder: Path, as_json: bool
) -> None:
    from rover_sweep.cli.identify import identified
    from rover_sweep.identify.grouping import Settings
    from rover_sweep.preparation import Reading, divided, load

    runs: tuple[Recording, ...] = load([str(path) for path in logs], vehicle, Reading())
    sweeps, doublets = divided(runs)
    identified(sweeps, doublets, (vehicle, vehicle_file), Settings(), folder / "report", as_json)
