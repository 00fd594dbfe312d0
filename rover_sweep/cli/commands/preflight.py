"""`rover-sweep preflight`: check the rover before a run, and fix single checks on request."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rover_sweep.cli.options import FOLDER, POSITIVE, option, options
from rover_sweep.cli.vehicle_link import JSON_ALONE, LINK, LinkOptions
from rover_sweep.cli.views.asking import confirmed, refuse_unasked
from rover_sweep.cli.views.output import echo_json, narration, results, say_next
from rover_sweep.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rover_sweep.vehicle.preflight.read_rover import Check

_STYLES = {"good": "green", "doubtful": "yellow", "bad": "red", "unknown": "yellow"}


@click.command()
@options
def preflight(
    rover: LinkOptions = LINK,
    fix: tuple[str, ...] = option(
        "Fix this check, e.g. --fix parameters; may be repeated.", metavar="NAME", multiple=True
    ),
    w_max: float | None = option(
        "Highest frequency of the planned sweep. [default: the applet's]", POSITIVE, "RAD/S"
    ),
    out: str = option("Folder for the recordings. [default: here]", FOLDER, default="."),
    yes: bool = option("Do not ask before a change or a reboot."),
    as_json: bool = JSON_ALONE,
) -> int:
    """Check everything needed before a run: firmware, applet, parameters, rates, filters,
    streams, clock, log, disk, battery, GPS, EKF, radio, switch, channel options, mode,
    the autopilot's own checks before arming.

    Changes nothing, except with --fix, which asks first and checks again afterwards. Nothing moves or arms.
    Exit code 0 if no check is bad, else 1.
    """
    from rover_sweep.cli.views.display import PlainDisplay
    from rover_sweep.vehicle.preflight.readiness import NAMES, remedy
    from rover_sweep.vehicle.preflight.readiness import preflight as look

    for name in fix:
        if name not in NAMES:
            raise UsageError(f"there is no check {name!r}; there are {', '.join(NAMES)}")
    refuse_unasked(yes or not fix, "fix")
    folder = Path(out)
    with rover.link() as link:
        checks = look(link, folder, w_max)
        for name in fix:
            check = next((c for c in checks if c.name == name), None)
            if check is None or check.remedy is None:
                narration().print(f"{name}: nothing to fix")
            elif check.remedy.by_hand or yes or confirmed(f"{name}: {check.remedy.words}?"):
                display = PlainDisplay(narration(), talk=True)
                for event in remedy(link, check, may_reboot=check.remedy.reboot, folder=folder):
                    display.show(event)
            checks = look(link, folder, w_max)
    if as_json:
        echo_json(json.dumps({"checks": [asdict(check) for check in checks]}, indent=2))
    else:
        _show(checks)
        _go_on(checks, rover.connect)
    return 1 if _count_bad(checks) else 0


def _count_bad(checks: Sequence[Check]) -> int:
    return sum(check.state == "bad" for check in checks)


def _go_on(checks: Sequence[Check], url: str) -> None:
    """Name the first bad check that can be fixed by this command, or the run."""
    bad = [check for check in checks if check.state == "bad"]
    fixed = [check.name for check in bad if check.remedy is not None and not check.remedy.by_hand]
    if fixed:
        say_next(f"rover-sweep preflight --connect {url} --fix {fixed[0]}")
    elif bad:
        say_next("fix the checks marked bad", f"rover-sweep preflight --connect {url}")
    else:
        say_next(f"rover-sweep run --connect {url} --vehicle rover.toml --out today")


def _show(checks: Sequence[Check]) -> None:
    """Print one line per check; below one that is not good, its sentence and its remedy."""
    from rich.text import Text

    console = results()
    for check in checks:
        line = Text(f"{check.name:11}")
        line.append(f"{check.state:9}", _STYLES[check.state]).append(check.seen)
        if check.state == "good" and check.sentence:
            line.append(f" ({check.sentence})", "dim")
        console.print(line, soft_wrap=True)
        if check.state != "good":
            console.print(Text(f"  {check.sentence}"), soft_wrap=True)
            if check.remedy is not None:
                key = "by hand" if check.remedy.by_hand else f"--fix {check.name}"
                console.print(Text(f"  {key}: {check.remedy.words}", "cyan"), soft_wrap=True)
    bad = _count_bad(checks)
    words = f"{bad} of {len(checks)} checks must be fixed" if bad else "ready for a run"
    console.print(words, style="red" if bad else "green")
