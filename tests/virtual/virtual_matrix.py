"""Every fault in every phase where it makes sense: the scenarios of the matrix.

`CASES` maps "fault @ phase" to a `Case`; `Case.played(folder)` is its outcome. `benign`: the run must come to
its end all the same.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from virtual_faults import (
    asleep,
    clock_set,
    cut,
    disarmed,
    disk_full,
    foreign_bytes,
    held,
    hole,
    interrupt,
    kill,
    power_lost,
    rc_lost,
    script_error,
    script_paused,
    script_silent,
    script_stopped,
    second_rover,
    stall,
    weather,
)
from virtual_pipe import Weather
from virtual_run import SETTINGS, Outcome, played
from virtual_world import PHASES, At, Fault, Phase

DRIVEN: tuple[Phase, ...] = ("waiting", "straight", "sweep", "after")
RUN: tuple[Phase, ...] = ("arming", "standing", *DRIVEN, "standing after", "letting go")
LATER_ENDED: tuple[Phase, ...] = ("connecting", "waiting", "sweep")  # for what lasts from then on
INTO_PHASE = 0.3  # s


@dataclass(frozen=True)
class Case:
    """A fault that begins `seconds` into a phase. benign: the run completes all the same. limit, after: as
    `played`. trigger: how the switch is thrown."""

    phase: Phase
    fault: Fault
    benign: bool = False
    seconds: float = INTO_PHASE
    limit: float = 90.0

    @property
    def name(self) -> str:
        return f"{self.fault.name} @ {self.phase}"

    def played(self, folder: Path, fault: Fault | None = None) -> Outcome:
        """The scenario's outcome; the world goes on for 10 s and for 5 s without the fault.

        fault: another one at the same moment."""
        happening = (At(self.phase, self.seconds), fault or self.fault)
        return played(folder, [happening], settings=SETTINGS, limit=self.limit, after=10.0, back=5.0)


Make = Callable[[], Fault]

_LASTING: tuple[tuple[tuple[Phase, ...], Make], ...] = (
    (PHASES, cut),
    (PHASES, hole),
    (PHASES, kill),
    (PHASES, interrupt),
    (RUN, lambda: hole(3.6)),
    (RUN, lambda: hole(4.5)),
    (DRIVEN, lambda: hole(1.5)),
    (DRIVEN, lambda: hole(7.0)),
    (RUN, lambda: hole(direction="down")),
    (RUN, lambda: hole(direction="up")),
    (DRIVEN, lambda: hole(2.0, "down")),
    (DRIVEN, lambda: hole(4.0, "down")),
    (DRIVEN, lambda: hole(2.0, "up")),
    (DRIVEN, lambda: hole(3.6, "up")),
    (DRIVEN, lambda: stall(2.0)),
    (DRIVEN, lambda: stall(3.6)),
    (DRIVEN, lambda: stall(4.5)),
    (DRIVEN, lambda: stall(3.6, "down")),
    (DRIVEN, lambda: stall(3.6, "up")),
    (DRIVEN, lambda: asleep(2.0)),
    (RUN, lambda: asleep(3.6, queues=False)),
    (RUN, lambda: asleep(40.6, queues=False)),
    (("standing", "sweep", "letting go"), lambda: asleep(40.6)),
    (("uploading", *RUN), lambda: power_lost(3.0)),
    (("arming", "sweep", "letting go"), lambda: power_lost(10.0)),
    (RUN, script_silent),
    (("standing", "waiting", "sweep"), script_stopped),
    (("waiting", "sweep", "standing after"), script_error),
    (("waiting", "sweep"), lambda: script_paused(2.0)),
    (RUN, lambda: rc_lost(1)),
    (RUN, lambda: rc_lost(2)),
    (("standing", "waiting", "sweep"), disarmed),
    (("standing", "waiting", "sweep"), held),
    (("uploading", *RUN), disk_full),
    (LATER_ENDED, lambda: weather("20 % lost", Weather(drop=0.2))),
    (LATER_ENDED, lambda: weather("50 % lost", Weather(drop=0.5))),
    (LATER_ENDED, lambda: weather("20 % corrupted", Weather(corrupt=0.2))),
    (LATER_ENDED, lambda: weather("2 s late", Weather(delay=2.0))),
    (LATER_ENDED, lambda: weather("jitter 1.5 s", Weather(jitter=1.5))),
    (("connecting", "sweep"), second_rover),
)
_BENIGN: tuple[tuple[tuple[Phase, ...], Make], ...] = (
    (DRIVEN, lambda: hole(0.6)),
    (("sweep",), lambda: stall(0.6)),
    (("sweep",), lambda: asleep(0.5)),
    (("uploading", "sweep"), lambda: weather("5 % lost", Weather(drop=0.05))),
    (("uploading", "sweep"), lambda: weather("5 % corrupted", Weather(corrupt=0.05))),
    (("uploading", "sweep"), lambda: weather("30 % twice", Weather(duplicate=0.3))),
    (("uploading", "sweep"), lambda: weather("30 % overtaken", Weather(reorder=0.3))),
    (("uploading", "sweep"), lambda: weather("0.3 s late", Weather(delay=0.3))),
    (("uploading", "sweep"), lambda: weather("jitter 0.3 s", Weather(jitter=0.3))),
    (("uploading", "sweep"), foreign_bytes),
    (("waiting", "sweep"), lambda: clock_set(3600.0)),
    (("waiting", "sweep"), lambda: clock_set(-3600.0)),
)


def _cases() -> Iterator[Case]:
    for benign, table in ((False, _LASTING), (True, _BENIGN)):
        for phases, make in table:
            for phase in phases:
                into = 0.0 if phase == "letting go" else INTO_PHASE
                yield Case(phase, make(), benign, into, limit=900.0 if phase == "connecting" else 90.0)
    for tenths in (32, 34, 36, 38, 42, 44, 45, 46, 48):
        yield Case("sweep", hole(tenths / 10), seconds=1.0)
    for tenths in (404, 405, 406, 407, 408):
        yield Case("sweep", asleep(tenths / 10, queues=False), seconds=1.0)


CASES = {f"{case.name} + {case.seconds:g} s": case for case in _cases()}


def _moments() -> dict[str, list[Case]]:
    """The cases by the moment at which their faults begin."""
    found: dict[str, list[Case]] = {}
    for case in CASES.values():
        found.setdefault(f"{case.phase} + {case.seconds:g} s", []).append(case)
    return found


MOMENTS = _moments()
