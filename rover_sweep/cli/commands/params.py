"""`rover-sweep params`: compare a rover's parameters with a file, set them, or save them."""

from __future__ import annotations

import json
import shlex
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rover_sweep.cli.options import SESSION, argument, option, options, refuse_no_folder, write_text
from rover_sweep.cli.vehicle_link import JSON_ALONE, LINK, VIA, LinkOptions
from rover_sweep.cli.views.asking import confirmed, reboot_consent, refuse_unasked
from rover_sweep.cli.views.output import (
    echo,
    echo_json,
    identify_command,
    narration,
    print_table,
    results,
    say_next,
)
from rover_sweep.errors import UsageError

if TYPE_CHECKING:
    from firmware_params.param_files import Difference, WantedParameter
    from rover_sweep.manoeuvre.sweep import Manoeuvre
    from rover_sweep.report.document import Tone
    from rover_sweep.session.content import DrivenRun
    from rover_sweep.vehicle.link.link import Link
    from rover_sweep.vehicle.logs import Via

_FILE = argument("[FILE]", default="identification")
_DISARM = "rover-sweep preflight --connect URL --fix armed"
_NOTES = Path()  # folder of reboot-pending.json: the current one


@click.group()
def params() -> None:
    """Compare or set a rover's parameters from a .param file: identification, raw_imu or your own file.

    Counters of the rover such as STAT_BOOTCNT are neither compared nor set.
    """


@params.command(short_help="Show the differences; changes nothing.")
@options
def diff(file: str = _FILE, rover: LinkOptions = LINK, as_json: bool = JSON_ALONE, via: Via = VIA) -> int:
    """Compare the rover with FILE. Changes nothing. Exit code 0 if nothing differs, 1 if something does."""
    from rover_sweep.vehicle.parameters import wanted_of

    wanted = wanted_of(file)
    with rover.link() as link:
        found = _differences(link, wanted, via)
    if as_json:
        echo_json(json.dumps({"file": file, "differences": [_document(d) for d in found]}, indent=2))
    else:
        _show(found, file)
        say_next(f"rover-sweep {f'params push {file}' if found else 'preflight'} --connect {rover.connect}")
    return 1 if found else 0


@params.command(short_help="Set the parameters that differ, after asking.")
@options
def push(
    file: str = _FILE,
    rover: LinkOptions = LINK,
    yes: bool = option("Do not ask, not even before a reboot."),
    as_json: bool = JSON_ALONE,
    via: Via = VIA,
) -> int:
    """Set the parameters that differ from FILE; every value is read back and compared.

    Shows the differences and asks first; asks again before a reboot. After an interruption, run it again: a
    pending reboot is noted in reboot-pending.json in the current folder. Missing or rejected parameters are
    reported; the rest are set. The rover must be disarmed. Exit code 0 if nothing differs afterwards and no
    reboot is pending, else 1.
    """
    from rover_sweep.cli.views.display import PlainDisplay
    from rover_sweep.vehicle.logs import parameter_source
    from rover_sweep.vehicle.parameters import ParameterSet, wanted_of
    from rover_sweep.vehicle.setup import awaiting_reboot
    from rover_sweep.vehicle.setup import push as bring

    refuse_unasked(yes, "set them")
    wanted, was_set = wanted_of(file), list[ParameterSet]()
    with rover.link() as link:
        found = _differences(link, wanted, via)
        _show(found, file, as_json)
        count = sum(d.found is not None for d in found)
        consent = yes or not count or confirmed(f"Set {count} parameters?")

        display, may_reboot = PlainDisplay(narration(), talk=True), reboot_consent(yes)
        for event in bring(link, parameter_source(link, via), found, may_reboot, _NOTES) if consent else ():
            display.show(event)
            was_set += [event] if isinstance(event, ParameterSet) else []
        left, due = _differences(link, wanted, via) if found else [], awaiting_reboot(link, _NOTES)
    if not as_json:
        say_next(f"rover-sweep {'params diff ' + file if left else 'preflight'} --connect {rover.connect}")
    if as_json:
        document = {
            "file": file,
            "set": [asdict(e) for e in was_set],
            "differences": [_document(d) for d in left],
        }
        echo_json(json.dumps(document | {"reboot_due": list(due)}, indent=2))
    return 1 if left or due else 0


@params.command(short_help="Save all parameters of the rover to a file.")
@options
def pull(
    file: str = argument("[FILE]", default="-"),
    rover: LinkOptions = LINK,
    as_json: bool = JSON_ALONE,
    via: Via = VIA,
) -> None:
    """Save all parameters of the rover to FILE (default: stdout), in the format of the ground stations."""
    from rover_sweep.vehicle.identity import identify_vehicle
    from rover_sweep.vehicle.logs import parameter_source
    from rover_sweep.vehicle.parameters import await_booted

    refuse_no_folder(file)
    if file != "-" and Path(file).is_file():
        raise UsageError(f"{file} already exists; give another name")
    with rover.link() as link:
        vehicle = identify_vehicle(link)
        await_booted(link, _wait)
        values = dict(sorted(parameter_source(link, via).read_all().items()))
    summary = f"{len(values)} parameters of {vehicle.firmware}"
    if file != "-" or not as_json:
        lines = [  # with enough digits to restore the same float32
            f"{name} {value:.0f}" if value.is_integer() and abs(value) < 1e9 else f"{name} {value:.9g}"
            for name, value in values.items()
        ]
        write_text(file, "\n".join([f"# {summary} ({vehicle.git_hash})", *lines, ""]), summary)
        if file != "-":
            say_next(f"rover-sweep params diff {file} --connect {rover.connect} (after a change)")
    if as_json:
        echo_json(json.dumps({"firmware": vehicle.firmware, "parameters": values}, indent=2))


def _differences(link: Link, wanted: Sequence[WantedParameter], via: Via) -> list[Difference]:
    from firmware_params.param_files import compare
    from rover_sweep.vehicle.identity import identify_vehicle
    from rover_sweep.vehicle.logs import parameter_source
    from rover_sweep.vehicle.parameters import await_booted, read_present

    identify_vehicle(link)
    one_by_one = via == "mavlink" and len(wanted) < _FEW
    if not one_by_one:
        await_booted(link, _wait)
    has = {} if one_by_one else parameter_source(link, via).read_all()
    # The full list omits parameters of a disabled feature, such as SCR_HEAP_SIZE with SCR_ENABLE 0.
    has |= read_present(link, [p.name for p in wanted if p.name not in has])
    return list(compare(has, wanted))


def _wait(seconds: float) -> None:
    echo(f"the rover has just booted: waiting up to {seconds:.0f} s for its full parameter list", err=True)


_FEW = 100  # below this, parameters are read one by one; reading all 1300 takes as long as 30 of them


def _document(d: Difference) -> dict[str, object]:
    from rover_sweep.vehicle.setup import needs_reboot

    document: dict[str, object] = {"name": d.name, "wanted": d.wanted, "found": d.found, "reason": d.reason}
    return document | {"reboot": needs_reboot(d.name, d.needs_reboot)}


def _show(found: Sequence[Difference], file: str, as_json: bool = False) -> None:
    from rover_sweep.vehicle.setup import needs_reboot

    console = results(as_json)
    if not found:
        console.print(f"all parameters of {file} are set on the rover", style="green")
        return
    rows = []
    for d in found:
        has = "-" if d.found is None else f"{d.found:.7g}"
        reboot = "yes" if needs_reboot(d.name, d.needs_reboot) else ""
        rows.append((d.name, has, f"{d.wanted:.7g}", reboot, d.reason))
    print_table(console, ("parameter", "rover", "file", "reboot", "why"), rows, text_columns=(0, 3, 4))
    console.print(f"{len(found)} differ", style="yellow")


_STATES: dict[str, Tone] = {"begun": "", "done": "good", "stopped": "warn", "cut": "warn"}


@click.command()
@options
def status(
    folder: Path = SESSION,
    as_json: bool = option("Print session.json and the remaining runs (to_drive) on stdout.", flag="--json"),
) -> None:
    """Show the driven runs of the session in FOLDER with their verdicts, and the runs that remain.

    Changes nothing; the session may be running.
    """
    from rover_sweep.report.document import Cell
    from rover_sweep.session.content import to_json
    from rover_sweep.session.folder import is_session, read_folder
    from rover_sweep.vehicle.run.controls import MAY_BE_ARMED

    if not is_session(folder):
        raise UsageError(f"{folder} is not a session folder: it has neither session.json nor a .tlog")
    content = read_folder(folder)
    if as_json:
        document = to_json(content) | {"to_drive": [run.name for run in content.to_drive]}
        echo_json(json.dumps(document, indent=2, default=str))
        return
    console = results()
    if content.left_armed:
        cut = f"{content.runs[-1].label} ended without a confirmed disarm. {MAY_BE_ARMED}"
        console.print(f"{cut}. `{_DISARM}` disarms it from here.", style="red", soft_wrap=True)
    firmware = content.vehicle.get("firmware", "an unknown rover")
    console.print(f"{folder}: {firmware}, {len(content.runs)} runs, {len(content.logs)} logs")
    if content.runs:
        rows = []
        for run in content.runs:
            log = next((log.file for log in content.logs if run.label in log.runs), "-")
            state = Cell(run.state, _STATES[run.state])
            rows.append((run.label, _describe(run.manoeuvre), state, log, _verdict(run)))
        print_table(console, ("run", "manoeuvre", "state", "log", "verdict"), rows, text_columns=5)
    left = ", ".join(f"{run.name} ({_describe(run.manoeuvre)})" for run in content.to_drive)
    remaining = f"still to drive: {left}" if left else "no runs remain"
    console.print(remaining, soft_wrap=True)
    on = f"rover-sweep resume {shlex.quote(str(folder))} --connect URL" if left else identify_command(folder)
    say_next(*([_DISARM] if content.left_armed else []), on)


def _verdict(run: DrivenRun) -> str:
    """The verdict of a complete run; the reason why another run ended."""
    if run.state != "done":
        return run.reason
    return str(run.verdict["sentence"]) if run.verdict else "not checked; use rover-sweep coherence"


def _describe(manoeuvre: Manoeuvre | None) -> str:
    return (
        "unknown" if manoeuvre is None else f"{manoeuvre.kind.replace('_', ' ')} {manoeuvre.amplitude:g} us"
    )
