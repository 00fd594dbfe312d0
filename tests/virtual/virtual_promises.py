"""What must hold whatever happens: for one case, with a rule left out, and for many cases at once.

    assert broken(outcome) == []

Nothing that moves the rover is sent more than `MAY_BE_LATE` after it was heard. When the laptop cannot reach
the vehicle, its last override holds for RC_OVERRIDE_TIME, which a run sets.
"""

from __future__ import annotations

import json
import os
import traceback
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from unittest import mock

from virtual_matrix import Case
from virtual_run import Outcome
from virtual_world import Fault, Killed, World

from rover_sweep.errors import RoverSweepError
from rover_sweep.vehicle.run import right_to_move
from rover_sweep.vehicle.run.right_to_move import Rule

MAY_BE_LATE = 1.0  # s
WINDS_DOWN = 0.4  # s that the throttle output takes to trim (MOT_SLEWRATE), and a message in flight
OVERRIDE_HOLDS = 1.5  # s until the applet goes to HOLD
WAITING_LIMIT = 15.0  # s that the throttle is held for, waiting for speed
WAITING, STEERED, NOT_DRIVEN = (2,), (3, 4, 5, 6, 7, 8), (0, 1, 9, 10)  # SWP_ST


def broken(outcome: Outcome, manoeuvre_s: float = 12.0) -> list[str]:
    """A sentence for each promise that the drive code did not keep. manoeuvre_s: length of the override."""
    return [sentence for promise in PROMISES for sentence in promise(outcome, manoeuvre_s)]


def _ended(outcome: Outcome, manoeuvre_s: float) -> Iterator[str]:
    if outcome.overran:
        yield f"it did not end: {outcome.error}"
    if isinstance(outcome.error, RoverSweepError) and not str(outcome.error):
        yield f"{type(outcome.error).__name__} says nothing"


def _asked(outcome: Outcome, manoeuvre_s: float) -> Iterator[str]:
    if outcome.unasked:
        yield f"the applet began runs {[n for _, n in outcome.record.begun]}, {outcome.asked} asked for"
    if outcome.again_high():
        yield "the switch was sent high again"


def _heard(outcome: Outcome, manoeuvre_s: float) -> Iterator[str]:
    if (late := outcome.sent_late()) > MAY_BE_LATE:
        yield f"throttle was sent {late:.2f} s after the vehicle was last heard"
    if (late := outcome.sent_late(lambda sent: sent.state_heard)) > MAY_BE_LATE:
        yield f"throttle was sent {late:.2f} s after the applet last told its state"
    if (late := max((sent.heard for sent in outcome.record.sent if sent.high), default=0.0)) > MAY_BE_LATE:
        yield f"the switch was sent high {late:.2f} s after the vehicle was last heard"
    if (late := outcome.record.driven_unheard()) > MAY_BE_LATE + WINDS_DOWN:
        yield f"the rover drove {late:.2f} s after it was last heard, though it could be stopped"


def _within_phases(outcome: Outcome, manoeuvre_s: float) -> Iterator[str]:
    waited = outcome.record.seconds_in(WAITING)
    if waited > WAITING_LIMIT + MAY_BE_LATE + WINDS_DOWN + OVERRIDE_HOLDS:
        yield f"driven for {waited:.1f} s while waiting for speed"
    steered = outcome.record.seconds_in(STEERED)
    if steered > manoeuvre_s + MAY_BE_LATE + WINDS_DOWN + OVERRIDE_HOLDS:
        yield f"driven for {steered:.1f} s in a manoeuvre of {manoeuvre_s:.1f} s"
    beyond = outcome.record.seconds_in(NOT_DRIVEN)
    if beyond > MAY_BE_LATE + WINDS_DOWN + OVERRIDE_HOLDS:
        yield f"driven for {beyond:.1f} s outside the manoeuvre"


def _reported(outcome: Outcome, manoeuvre_s: float) -> Iterator[str]:
    if wrong := outcome.misreported():
        yield wrong
    if outcome.left_armed and not outcome.killed and "armed" not in outcome.said:
        yield f"it ended with the rover armed and does not say so: {outcome.said!r}"


PROMISES: tuple[Callable[[Outcome, float], Iterator[str]], ...] = (
    _ended,
    _asked,
    _heard,
    _within_phases,
    _reported,
)


# ---- The drive code with a rule taken out: a scenario that depends on the rule must notice.


def without(*names: str) -> tuple[Rule, ...]:
    """The rules of the right to move but for these."""
    assert {rule.__name__ for rule in right_to_move.RULES} >= set(names), names
    return tuple(rule for rule in right_to_move.RULES if rule.__name__ not in names)


def noticed(place: str, instead: object, case: Case, folder: Path) -> list[str]:
    """The promises that are broken in `case` with `place` (a dotted name) replaced by `instead`.

    AttributeError where there is no such place.
    """
    with mock.patch(place, instead):
        return problems(case, folder)


def problems(case: Case, folder: Path) -> list[str]:
    """What `broken` says of a case, and a benign one that does not come to its end."""
    return judged(case, case.played(folder))


def judged(case: Case, outcome: Outcome) -> list[str]:
    """The same of an outcome."""
    wrong = broken(outcome)
    if not outcome.fired:
        wrong.append("the fault did not happen")
    if case.benign and not (outcome.finished and outcome.finished.completed):
        wrong.append(f"a run that could have been completed was not: {outcome.said}")
    return wrong


# ---- Cases that share their beginning: it is run once, and a fork of this process goes on with each case.


def problems_of(cases: Sequence[Case], folder: Path) -> dict[str, list[str]]:
    """`problems` of cases that differ in the fault only, by the name of the case."""
    if not hasattr(os, "fork"):
        return {case.name: problems(case, folder / str(k)) for k, case in enumerate(cases)}
    trunk = _Trunk(cases, folder)
    (first, *_) = cases
    assert {(case.phase, case.seconds, case.limit) for case in cases} == {
        (first.phase, first.seconds, first.limit)
    }
    try:
        outcome = first.played(folder, Fault("fork", trunk.fork))
        trunk.ended(outcome)
    except BaseException:
        trunk.ended(traceback.format_exc())
        raise
    return trunk.found


@dataclass
class _Trunk:
    """found: what each case gave. case, answer: in a fork, its case and the pipe for what it gives."""

    cases: Sequence[Case]
    folder: Path

    def __post_init__(self) -> None:
        self.found: dict[str, list[str]] = {}
        self.case: Case | None = None
        self.answer = -1

    def fork(self, world: World) -> None:
        """Called when the fault begins. Returns in each fork, and at last here, where the run then ends."""
        files = _Files(self.folder)
        for case in self.cases:
            read, write = os.pipe()
            if (pid := os.fork()) == 0:
                os.close(read)
                self.case, self.answer = case, write
                world.instead(case.fault)
                return
            os.close(write)
            with os.fdopen(read, encoding="utf-8") as answer:
                text = answer.read()
            os.waitpid(pid, 0)
            self.found[case.name] = json.loads(text) if text else ["the fork of this process died"]
            files.put_back()
        world.laptop.death = Killed()

    def ended(self, result: Outcome | str) -> None:
        """Ends a fork, with what came of its case."""
        if self.case is None:
            return
        try:
            wrong = [result] if isinstance(result, str) else judged(self.case, result)
            os.write(self.answer, json.dumps(wrong).encode())
        finally:
            os._exit(0)


class _Files:
    """All files in a folder, and how far those that are open have been read or written."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._content = {path: path.read_bytes() for path in self._paths()}
        inodes = {path.stat().st_ino for path in self._content}
        self._offsets = {fd: os.lseek(fd, 0, os.SEEK_CUR) for fd in _open() if os.fstat(fd).st_ino in inodes}

    def put_back(self) -> None:
        """As they were. A file that is open stays the same file."""
        for path in self._paths():
            if path not in self._content:
                path.unlink()
        for path, content in self._content.items():
            with path.open("r+b" if path.exists() else "wb") as file:
                file.write(content)
                file.truncate()
        for fd, offset in self._offsets.items():
            os.lseek(fd, offset, os.SEEK_SET)

    def _paths(self) -> list[Path]:
        return [path for path in self._folder.rglob("*") if path.is_file()]


def _open() -> list[int]:
    """File descriptors of this process."""
    found = []
    for name in os.listdir("/dev/fd"):
        try:
            os.fstat(int(name))
        except OSError:  # that of the listing itself
            continue
        found.append(int(name))
    return found
