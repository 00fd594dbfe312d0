"""`rover-sweep redrive`: a log's own steering and speed through a simulation, recorded like a drive."""

from __future__ import annotations

import errno
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rover_sweep.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rover_sweep.data.recording import Recording
    from rover_sweep.logs.log import Log

_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS)


@click.command()
@click.argument("log", metavar="LOG")
@click.option(
    "--vehicle",
    "simulator",
    default="plant",
    show_default=True,
    type=click.Choice(("plant", "embedded", "ardurover")),
    help="The physics alone, the embedded rover, or the real firmware in SITL before the same physics.",
)
@click.option(
    "--variant",
    default="nominal",
    show_default=True,
    metavar="NAME|FILE",
    help="Physics of the simulated rover: a name as in dry-run, or a TOML file; its table "
    "[effects] switches physics on that is not nominal.",
)
@click.option(
    "--rover-file",
    type=click.Path(dir_okay=False),
    metavar="FILE",
    help="rover.toml, whose masses, lengths and steering replace the variant's.",
)
@click.option(
    "--ardurover",
    type=click.Path(dir_okay=False),
    metavar="FILE",
    help="The ArduRover SITL program (else $ROVER_SWEEP_ARDUROVER, else the PATH).",
)
@click.option("--seed", type=click.IntRange(min=0), default=1, show_default=True, help="Of noise and road.")
@click.option(
    "--out",
    type=click.Path(dir_okay=False),
    metavar="FILE",
    required=True,
    help="The recording to write (.BIN).",
)
def redrive(
    log: str, simulator: str, variant: str, rover_file: str | None, ardurover: str | None, seed: int, out: str
) -> None:
    """Drive LOG once more in a simulation: its steering PWM at its times, its speed followed.

    What comes out is a recording that every command reads like LOG, on LOG's clock, so that
    `rover-sweep diagnose LOG --simulation OUT` can tell where field and simulation differ. The plant
    takes about a second a drive; the firmware drives in real time.
    """
    from rover_sweep.cli.views.output import narration
    from rover_sweep.redrive.recorded_course import course_of
    from rover_sweep.redrive.vehicle_variant import described, on_the_clock, refuse_instant, simulated_rover

    target = _target(out, log)
    parameters = simulated_rover(variant, rover_file)
    if simulator != "plant":
        refuse_instant(parameters, simulator)
    runs = _runs(log)
    course = course_of(_one_log(log))
    console = narration()
    console.print(
        f"{simulator}, {described(parameters, variant, rover_file)}", highlight=False, soft_wrap=True
    )
    with _made_whole(target) as made:
        if simulator == "plant":
            from sitl.redrive.open_loop import redrive as drive

            try:
                drive(course, on_the_clock(parameters, runs), made, seed)
            except ValueError as error:  # the rover overturns
                raise UsageError(str(error)) from error
        else:
            from rover_sweep.redrive.on_autopilot import played

            binary = Path(ardurover) if ardurover else None
            for line in played(course, parameters, made, simulator, binary, seed):
                console.print(line, soft_wrap=True, markup=False)
    _tell(runs, target)


@contextmanager
def _made_whole(target: Path) -> Iterator[Path]:
    """Where to write the recording; it is put at the target whole or, with a UsageError, not at all."""
    from rover_sweep.files.replaced import write_file

    try:
        with tempfile.TemporaryDirectory() as folder:
            yield Path(folder) / target.name
            data = (Path(folder) / target.name).read_bytes()
    except OSError as error:
        if error.errno not in _NO_ROOM:
            raise
        where = f"{target} cannot be written: {error.strerror} in {tempfile.gettempdir()}"
        raise UsageError(f"{where}; make room there, or set TMPDIR to another place") from error
    write_file(target, data)


def _target(out: str, log: str) -> Path:
    path = Path(out)
    if path.suffix.lower() != ".bin":
        raise UsageError(f"--out {out}: the recording is a DataFlash log; give a name that ends in .BIN")
    if path.exists():
        raise UsageError(f"--out {out} is there already; give another name")
    if not path.parent.is_dir():
        raise UsageError(f"--out {out}: there is no folder {path.parent}")
    return path


def _runs(source: str) -> Sequence[Recording]:
    """The runs of the log; DataRefused, as everywhere, where there is none."""
    from rover_sweep.logs.read import read_runs

    return read_runs(source)


def _one_log(source: str) -> Log:
    """The drive to repeat; refused where the source holds several."""
    from rover_sweep.logs.read import read_logs
    from rover_sweep.logs.readers.implausible import screened

    logs = read_logs(source)
    if len(logs) != 1:
        raise UsageError(f"{source} holds {len(logs)} logs; part them and give one")
    return screened(logs[0])


def _tell(runs: Sequence[Recording], target: Path) -> None:
    """How the speeds of both recordings agree, read back as every command will read them."""
    import numpy as np

    from rover_sweep.cli.views.output import results
    from rover_sweep.logs.read import read_runs

    console = results()
    simulated = read_runs(str(target))
    for run, again in zip(runs, simulated, strict=False):
        speed = run.manoeuvre("speed")
        off = again["speed"].on(speed.t) - speed.x
        console.print(
            f"{run.name}: {run.span[1] - run.span[0]:.1f} s at {run.mean_speed:.2f} m/s; the simulated speed "
            f"is off by {np.mean(off):+.3f} m/s, rms {np.sqrt(np.mean(off**2)):.3f} m/s",
            soft_wrap=True,
            markup=False,
        )
    console.print(f"{target}: {len(simulated)} run(s)", soft_wrap=True, markup=False)
