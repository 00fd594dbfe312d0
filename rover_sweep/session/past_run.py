"""The outcome of a run from its tlog alone, for a run during which the program was killed."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from rover_sweep.files.printable import printable
from rover_sweep.manoeuvre.configured import configured_manoeuvre
from rover_sweep.manoeuvre.sweep import Manoeuvre
from rover_sweep.session.content import Span, State

if TYPE_CHECKING:
    from rover_sweep.logs.readers.vehicle_clock import BootMessages

_DONE = re.compile(r"^SWP: run (\d+) done")
_STOPPED = re.compile(r"^SWP: run (\d+) stopped:? *(.*)")
_STOPPED_STATE = 10


@dataclass(frozen=True)
class Outcome:
    """state: never "begun"; span: from the applet's first state to its last [s since boot]."""

    state: State
    reason: str
    span: Span | None
    number: int
    manoeuvre: Manoeuvre | None


def outcome_of(path: Path) -> Outcome | None:
    """The outcome of the run in a tlog; None if the applet did nothing in it.

    Only the part after the vehicle's last boot counts, because a reboot ends a run.
    """
    from rover_sweep.logs.readers.tlog import open_tlog
    from rover_sweep.logs.readers.vehicle_clock import CLOCKS, sessions

    wanted = frozenset((*CLOCKS, "NAMED_VALUE_FLOAT", "STATUSTEXT", "PARAM_VALUE"))
    boots = list(sessions(open_tlog(path, wanted).messages))
    if not boots:
        return None
    last = boots[-1]
    named, values = _named(last), _parameters(last)
    states = [(t, int(value)) for t, name, value in named if name == "SWP_ST"]
    active = [(t, state) for t, state in states if state > 0]
    if not active:
        return None
    number = next((int(value) for _, name, value in reversed(named) if name == "SWP_RUN"), 0)
    return _outcome(_texts(last), states, active[0][0], number, configured_manoeuvre(values))


def _outcome(
    texts: list[tuple[float, str]],
    states: list[tuple[float, int]],
    start: float,
    number: int,
    manoeuvre: Manoeuvre | None,
) -> Outcome:
    """The outcome by the applet's last status text, else by its last state."""
    end, state = states[-1]
    for t, text in reversed(texts):
        if t < start:
            break
        if match := _DONE.match(text):
            return Outcome(
                "done", "the manoeuvre ran to its end", (start, max(t, end)), int(match[1]), manoeuvre
            )
        if match := _STOPPED.match(text):
            reason = match[2] or "stopped by the applet"
            return Outcome("stopped", reason, (start, max(t, end)), int(match[1]), manoeuvre)
    if state == _STOPPED_STATE:
        return Outcome("stopped", "stopped by the applet", (start, end), number, manoeuvre)
    reason = f"the recording ends {end - start:.0f} s into the run"
    return Outcome("cut", reason, (start, end), number, manoeuvre)


def _named(boot: BootMessages) -> list[tuple[float, str, float]]:
    if "NAMED_VALUE_FLOAT" not in boot.messages:
        return []
    rows = boot.messages["NAMED_VALUE_FLOAT"].rows
    names = [name.decode("ascii", "replace") for name in rows["name"].tolist()]
    times = boot.seconds("NAMED_VALUE_FLOAT").tolist()
    values = rows["value"].astype(float).tolist()
    return [said for said in zip(times, names, values, strict=True) if math.isfinite(said[2])]


def _texts(boot: BootMessages) -> list[tuple[float, str]]:
    if "STATUSTEXT" not in boot.messages:
        return []
    texts = [
        printable(text.decode("utf-8", "replace"))
        for text in boot.messages["STATUSTEXT"].rows["text"].tolist()
    ]
    return list(zip(boot.seconds("STATUSTEXT").tolist(), texts, strict=True))


def _parameters(boot: BootMessages) -> Mapping[str, float]:
    if "PARAM_VALUE" not in boot.messages:
        return {}
    rows = boot.messages["PARAM_VALUE"].rows
    names = [printable(name.decode("ascii", "replace")) for name in rows["param_id"].tolist()]
    values = [float(f"{value:.7g}") for value in rows["param_value"].tolist()]  # float32: 0.3, not 0.30000001
    return {name: value for name, value in zip(names, values, strict=True) if math.isfinite(value)}
