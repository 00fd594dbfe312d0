"""Records tests/data/conversations anew, on the official firmware in SITL:

    python tests/vehicle/record_conversations.py ARDUROVER [NAME...]

Each conversation is played back at once and kept only where that gives the same (a wait that ended within
a few milliseconds of a message may be told differently by the recording's clock). Without NAMEs all of them.
"""

from __future__ import annotations

import json
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import version
from itertools import zip_longest
from pathlib import Path
from typing import Any

from conversation_file import read_conversation
from conversation_scenarios import (
    APPLET,
    CONVERSATIONS,
    PARAMETERS,
    SCENARIOS,
    THROTTLE_US,
    carried_out,
    nobody,
)
from transport_replayed import ReplayedLine

from firmware_params.applet_parameters import applet_path
from firmware_params.param_files import shipped
from rover_sweep.live.source import Update
from rover_sweep.session.simulated_rover import pilot
from rover_sweep.vehicle.events import Event, StateChanged, SwitchWanted
from rover_sweep.vehicle.identity import identify_vehicle
from rover_sweep.vehicle.link.link import Link, Refused
from rover_sweep.vehicle.link.recorded_transport import RecordedLine
from rover_sweep.vehicle.parameters import write_parameter
from rover_sweep.vehicle.run.controls import Channels, Controls, pump
from rover_sweep.vehicle.run.right_to_move import MovementLimits, RightToMove
from sitl.launcher import Running, start_ardurover

TRIES = 3
_SMALL_LOG = "LOG_BITMASK 0\n"


def main(binary: Path, names: tuple[str, ...]) -> None:
    """Record the conversations of these names."""
    CONVERSATIONS.mkdir(parents=True, exist_ok=True)
    shutil.copy(applet_path(), APPLET)
    shutil.copy(shipped("identification"), PARAMETERS)
    for name in names:
        for attempt in range(TRIES):
            began = time.monotonic()
            with tempfile.TemporaryDirectory() as folder:
                words = _recorded(binary, name, Path(folder))
            print(
                f"{name}, try {attempt + 1}, {time.monotonic() - began:.0f} s: {words or 'kept'}", flush=True
            )
            if not words:
                break


def _recorded(binary: Path, name: str, folder: Path) -> str:
    """'' where the conversation was kept, else why not."""
    with _rover(binary, name, folder / "rover") as rover:
        firmware = _prepared(rover, name, folder)
        told, path = _pilot(rover, name), folder / f"{name}.conversation"
        about = {"url": rover.connection, "pymavlink": version("pymavlink"), "firmware": firmware}
        live = folder / "live"
        live.mkdir()
        with told as pilot_told, RecordedLine(path, about=about) as line:
            then = carried_out(SCENARIOS[name], rover.connection, live, line, pilot_told)
    then = json.loads(json.dumps(then))
    replay = folder / "replay"
    replay.mkdir()
    again = ReplayedLine(read_conversation(path))
    try:
        now = carried_out(SCENARIOS[name], rover.connection, replay, again)
        again.finish()
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    if (again_plain := json.loads(json.dumps(now))) != then:
        return f"played back, it gives something else: {_first_difference(then, again_plain)}"
    place = CONVERSATIONS / firmware
    place.mkdir(exist_ok=True)
    shutil.copy(path, place / path.name)
    (place / f"{name}.json").write_text(json.dumps(then, indent=None, separators=(",", ":")) + "\n")
    return ""


def _first_difference(then: dict[str, Any], now: dict[str, Any]) -> str:
    pairs = zip_longest(then["events"], now["events"])
    found = next(((a, b) for a, b in pairs if a != b), (then["files"], now["files"]))
    return f"{found[0]} then, {found[1]} now"


@contextmanager
def _rover(binary: Path, name: str, home: Path) -> Iterator[Running]:
    home.mkdir()
    if name == "install":
        with start_ardurover(binary, home) as rover:
            yield rover
        return
    defaults = [PARAMETERS]
    if name == "log":
        (home / "small.param").write_text(_SMALL_LOG)
        defaults.append(home / "small.param")
    with start_ardurover(binary, home, defaults=defaults, scripts=[APPLET]) as rover:
        yield rover


def _prepared(rover: Running, name: str, folder: Path) -> str:
    """Version of the firmware; a rover whose log is to be fetched has been armed for a moment."""
    with Link.open(rover.connection, folder / "before.tlog", timeout=60.0) as link:
        firmware = ".".join(map(str, identify_vehicle(link).version))
        if name == "log":
            write_parameter(link, "SWP_ENABLE", 0)
            _armed_for_a_moment(link)
        elif name != "install":
            pump(link, 30.0, wall_limit=60.0)  # so that the conversation is not all waiting for the EKF
    return firmware


def _armed_for_a_moment(link: Link) -> None:
    right = RightToMove(link.line, link.clock, MovementLimits())
    controls = Controls(link, Channels(1, 3, 6, 1500, 1500), "override", False, right)
    controls.take()
    for _ in range(60):
        pump(link, 1.0)
        try:
            controls.arm()
            break
        except Refused:
            continue
    pump(link, 1.0)
    controls.let_go()
    link.request_message("SYSTEM_TIME")
    for _ in range(20):  # a log goes on for 15 s after disarming
        link.wait_for("NOTHING", 1.0)


@contextmanager
def _pilot(rover: Running, name: str) -> Iterator[Update]:
    """Who throws the switch where it is the pilot's: high when asked, low 3 s into the sweep."""
    if name != "switch":
        yield nobody
        return
    with pilot(rover, THROTTLE_US) as told:
        since: list[float] = []

        def pilot_told(event: Event) -> None:
            told(event)
            if isinstance(event, StateChanged) and event.state == 6:
                since.append(event.t)
            if since and getattr(event, "t", 0.0) > since[0] + 3.0:
                told(SwitchWanted("low", 6))

        yield pilot_told


if __name__ == "__main__":
    main(Path(sys.argv[1]), tuple(sys.argv[2:]) or tuple(SCENARIOS))
