"""`rover-sweep gains`: compute the gains of the steering and speed controllers from identified models."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rover_sweep.cli.options import (
    FILE,
    NumberRange,
    argument,
    option,
    options,
    refuse_input,
    refuse_no_folder,
)
from rover_sweep.cli.vehicle_link import ACCESS, LinkOptions
from rover_sweep.errors import LinkError, UsageError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from rover_sweep.api.speed import AllGains
    from rover_sweep.vehicle.link.connection import Access


@click.command(short_help="Compute steering and speed gains for the autopilot from identified models.")
@options
def gains(
    place: str | None = argument("IDENTIFICATION|DIAGNOSIS|FOLDER", type=click.Path(), required=False),
    check: tuple[str, ...] = option(
        "Check the gains in a log of a drive in ACRO or AUTO; twice: before and after.",
        FILE,
        "LOG",
        multiple=True,
    ),
    speed: float | None = option("Design speed. [default: that of the runs]", NumberRange(0.1, 50), "M/S"),
    model: str | None = option(
        "roll-yaw, bicycle or kinematic. [default: the recommended one]", None, "NAME"
    ),
    vehicle: str | None = option("Vehicle file with rad_per_us, if the identification has none.", FILE),
    now: str | None = option("Current parameters of the vehicle, to compare.", FILE, "FILE.param|LOG.BIN"),
    connect: str | None = option(
        "Read the current parameters from the vehicle; changes nothing.", None, "URL"
    ),
    access: Access = ACCESS,
    corridor: float = option(
        "Half width of the corridor of the 90 degree corners.", NumberRange(0.05, 100), "M", default=1.0
    ),
    out: str | None = option(
        "Write the proposed parameters to this file, and the present ones to undo-FILE.param.",
        FILE,
        "FILE.param",
    ),
    as_json: bool = option("Print everything as JSON on stdout.", flag="--json"),
) -> None:
    """Compute ATC_STR_RAT_FF, P, I, D and IMAX from the report of `identify`, `run` or `diagnose`.

    With it ATC_STR_RAT_MAX and ATC_TURN_MAX_G; and, if the report is (also) of throttle sweeps, CRUISE_SPEED,
    CRUISE_THROTTLE, ATC_SPEED_P, I, D and ATC_ACCEL_MAX.

    Shows gain and phase margins, the predicted step response, the valid speed range, and the same for the
    current parameters. P and I keep margins of 6 dB and 45 deg for all parameter values within their 90 %
    intervals, from speed/1.5 to 1.5 speed. The loop includes the firmware's scaling with speed
    (MOT_SPD_SCA_BASE). A table has the path round a 90 degree corner. Gains need a model that predicts a
    held-out run and has plausible numbers, from a diagnosis one that explains the runs; else the reasons
    are shown and no file is written. One proposal raises no gain by more than a factor of 2.

    \b
    rover-sweep gains report --now log.BIN --speed 2.5 --out gains.param

    With --check the command reads how the vehicle followed its target in a log with PIDS messages (.BIN) or
    PID_TUNING (.tlog): error, lag, overshoot, the limits that were reached, whether FF is too low or too high
    and whether the loop oscillates; and one parameter to change next. With an identification it also
    predicts the same drive. A log in which the controller did not run, as in MANUAL, gives a first
    ATC_STR_RAT_FF with its interval.

    \b
    rover-sweep gains report --check before.BIN --check after.BIN

    Nothing is changed on a vehicle. Load the file with a ground station, and test it first with the wheels
    off the ground; load undo-gains.param to undo it.
    """
    from rover_sweep.api.gains import recorded_parameters
    from rover_sweep.api.speed import all_gains
    from rover_sweep.cli.views.output import echo_json, narration, results

    if check:
        _check(check, place, model, vehicle, as_json)
        return
    if place is None:
        raise UsageError("give the report of identify, run or diagnose; or --check LOG to check a drive")
    if out is not None:
        for written in (out, str(_undo_of(Path(out)))):
            refuse_input(written, place, now, vehicle)
    if now and connect:
        raise UsageError("--now and --connect both give the current parameters; give only one of them")
    current: Mapping[str, float] = recorded_parameters(Path(now)) if now else {}
    current = _parameters_over(connect, access) if connect else current
    both = all_gains(Path(place), model, vehicle, current, now or connect or "the defaults", speed, corridor)
    if as_json:
        echo_json(json.dumps(both.document, indent=2))
    else:
        from rover_sweep.report.gains_report import gains_report
        from rover_sweep.report.on_terminal import on_terminal
        from rover_sweep.report.speed_report import speed_gains_report

        console = results()
        if both.steering is not None:
            console.print(on_terminal(gains_report(both.steering, both.limits, both.corners, corridor)))
        if both.speed is not None:
            console.print(on_terminal(speed_gains_report(both.speed)))
    if out is None and both.text:
        narration().print("next: write them to a file with --out gains.param", soft_wrap=True)
    if out is not None:
        narration().print(_write(both, Path(out), now), soft_wrap=True)


def _check(
    logs: Sequence[str], place: str | None, model: str | None, vehicle: str | None, as_json: bool
) -> None:
    """Print the checks of one log or of two."""
    from rover_sweep.api.gains import check_gains, read_identified
    from rover_sweep.cli.views.output import echo_json, results
    from rover_sweep.gains.gains_json import check_document
    from rover_sweep.report.gains_check_report import check_report, first_report
    from rover_sweep.report.on_terminal import on_terminal

    found = read_identified(Path(place), model, vehicle) if place else None
    checked = check_gains([Path(log) for log in logs], found)
    now = (checked.steering, checked.speed)
    if as_json:
        echo_json(json.dumps(check_document(checked.before, now, checked.first), indent=2))
    elif checked.first is not None:
        results().print(on_terminal(first_report(checked.first)))
    else:
        results().print(on_terminal(check_report(checked.before, now)))


def _parameters_over(url: str, access: Access) -> dict[str, float]:
    """The parameters of steering and speed read from a vehicle; nothing is written to it."""
    from rover_sweep.gains.speed_chain import SPEED_DEFAULTS
    from rover_sweep.gains.steering_chain import DEFAULTS, SERVO_DEFAULTS, SERVO_OUTPUTS
    from rover_sweep.vehicle.parameters import read_present

    names = (
        set(DEFAULTS)
        | set(SPEED_DEFAULTS)
        | {f"SERVO{n}_{key}" for n in range(1, SERVO_OUTPUTS + 1) for key in ("FUNCTION", *SERVO_DEFAULTS)}
    )
    with LinkOptions(url, access).link() as link:
        found = read_present(link, names)
    if "ATC_STR_RAT_FF" not in found:
        raise LinkError(f"{url} has no ATC_STR_RAT_FF: is it a rover?")
    return found


def _write(both: AllGains, path: Path, now: str | None) -> str:
    """Write the file and the one that undoes it; returns a sentence that they were written, or why not.

    now: the file with the present parameters, if there is one.
    """
    from rover_sweep.files.documents import write_file

    if not both.text:
        return f"{path} was not written: there are no gains to propose"
    refuse_no_folder(str(path))
    if both.unknown:
        names = ", ".join(both.unknown)
        unknown = f"{now} lacks {names}" if now else f"the present values of {names} are unknown"
        raise UsageError(
            f"{path} was not written: {unknown}, so the change could not be undone; give all parameters of "
            "the vehicle with --now or --connect"
        )
    undo = write_file(_undo_of(path), both.undo)
    write_file(path, both.text)
    return f"parameters written to {path}; {undo} undoes them"


def _undo_of(path: Path) -> Path:
    return path.with_name(f"undo-{path.name}")
