"""`rover-sweep gains`: the steering controller's gains out of an identified model."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rover_sweep.cli.access import access_options
from rover_sweep.cli.options import NumberRange
from rover_sweep.errors import UsageError

if TYPE_CHECKING:
    from rover_sweep.gains.firmware import Autopilot
    from rover_sweep.gains.identified import Identified
    from rover_sweep.gains.proposal import Proposal
    from rover_sweep.vehicle.access import Access


@click.command(short_help="Steering gains for the autopilot out of an identified model.")
@click.argument("place", metavar="IDENTIFICATION|DIAGNOSIS|FOLDER", type=click.Path())
@click.option("--speed", type=NumberRange(0.1, 50), metavar="M/S",
              help="Speed they are for; that of the runs if not said.")  # fmt: skip
@click.option(
    "--model", "name", metavar="NAME", help="roll-yaw, bicycle or kinematic; the recommended one if not said."
)
@click.option("--vehicle", "vehicle_file", type=click.Path(dir_okay=False), metavar="FILE",
              help="Vehicle file with rad_per_us, where the identification has none.")  # fmt: skip
@click.option("--now", type=click.Path(dir_okay=False), metavar="FILE.param|LOG.BIN",
              help="What the vehicle flies now.")  # fmt: skip
@click.option(
    "--connect", "url", metavar="URL", help="The same, read from the vehicle; nothing is changed on it."
)
@access_options
@click.option(
    "--out", type=click.Path(dir_okay=False), metavar="FILE.param", help="Write the proposal as parameters."
)
@click.option("--json", "as_json", is_flag=True, help="Everything as JSON on stdout.")
def gains(
    place: str, speed: float | None, name: str | None, vehicle_file: str | None, now: str | None,
    url: str | None, access: Access, out: str | None, as_json: bool,
) -> None:  # fmt: skip
    """Compute ATC_STR_RAT_FF, P, I, D and IMAX from the report of `identify`, `run` or `diagnose`.

    With gain and phase margins, the step they will show, the speeds at which they hold, and the same for what
    the vehicle flies now. P and I keep 6 dB and 45 deg for every rover within the parameters' intervals, from
    the speed over 1.5 to 1.5 times it; the firmware's scaling with speed (MOT_SPD_SCA_BASE) is part of the
    loop. What the identification does not carry is said, and then no file is written.

    \b
    rover-sweep gains report --now log.BIN --speed 2.5 --out gains.param

    Nothing is changed on a vehicle: load the file with a ground station, and try it with the wheels off the
    ground first.
    """
    from rover_sweep.cli.output import echo_json, narration, results
    from rover_sweep.gains.document import gains_document

    found = _identified(Path(place), name, vehicle_file)
    proposal = _proposal(found, _autopilot(found, now, url, access), speed)
    if as_json:
        echo_json(json.dumps(gains_document(proposal), indent=2))
    else:
        from rover_sweep.cli.gains_view import show

        show(results(), proposal)
    if out is not None:
        narration().print(_write(proposal, Path(out)), markup=False, soft_wrap=True)


def _identified(place: Path, name: str | None, vehicle_file: str | None) -> Identified:
    from rover_sweep.cli.gains_input import identified
    from rover_sweep.gains.identified import PHYSICAL, with_steering
    from rover_sweep.vehicle_file import load

    if name is not None and name not in PHYSICAL:
        raise UsageError(
            f"--model {name}: gains need a model that holds at other speeds: {', '.join(PHYSICAL)}"
        )
    found = identified(place, name)
    return with_steering(found, load(vehicle_file).steering()[1]) if vehicle_file else found


def _autopilot(found: Identified, now: str | None, url: str | None, access: Access) -> Autopilot:
    from rover_sweep.cli.gains_input import parameters_of, parameters_over
    from rover_sweep.gains.firmware import autopilot

    if now and url:
        raise UsageError("--now and --connect both say what the vehicle flies; give one of them")
    flown = parameters_of(Path(now)) if now else parameters_over(url, access) if url else {}
    known = (("INS_GYRO_FILTER", found.gyro_hz), ("SCHED_LOOP_RATE", found.loop_hz))
    try:
        return autopilot(flown, {name: value for name, value in known if value is not None})
    except ValueError as error:
        raise UsageError(f"{now or url or 'the defaults'}: {error}") from None


def _proposal(found: Identified, loop: Autopilot, speed: float | None) -> Proposal:
    from rover_sweep.gains.proposal import propose

    try:
        return propose(found, loop, speed)
    except ValueError as error:
        raise UsageError(f"no loop can be computed: {error}") from None


def _write(proposal: Proposal, path: Path) -> str:
    """Writes the file, or says why not."""
    from rover_sweep.gains.param_file import param_text
    from rover_sweep.report.files import write_file

    if proposal.proposed is None:
        return f"{path} was not written: there is nothing to propose"
    if not path.parent.is_dir():
        raise UsageError(f"there is no folder {path.parent} to write {path.name} into; make it")
    write_file(path, param_text(proposal))
    return f"parameters written to {path}"
