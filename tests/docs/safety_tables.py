"""Tables of docs/safety.md that follow from code and tests: `python tests/docs/safety_tables.py` writes them.

A row of the virtual matrix is a kind of fault; each kind belongs to a cause of the page (`CAUSES`). A fault,
a stop of the applet or a scenario that is added to the tests is missing until the page is written again.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

sys.path.extend(
    str(Path(__file__).parents[1] / name) for name in ("virtual", "firmware_params", "ardurover", "vehicle")
)

from test_faults_firmware import SCENARIOS
from test_stopping import CONDITIONS, STEERED
from test_stopping_firmware import test_the_motor_is_back as motor
from test_stopping_firmware import test_the_steering_is_back as steering
from virtual_matrix import CASES, Case
from virtual_promises import MAY_BE_LATE, OVERRIDE_HOLDS, WAITING_LIMIT, WINDS_DOWN
from virtual_world import PHASES

from rover_sweep.vehicle.run.controls import INSISTS
from rover_sweep.vehicle.run.right_to_move import HEARD, REPORTED, WAITING
from rover_sweep.vehicle.run.takeover import LAPSE, OVERRIDE_TIME

PAGE = Path(__file__).parents[2] / "docs/safety.md"
CAUSES: tuple[tuple[str, str, str], ...] = (  # cause of the page; faults of the matrix; in words
    ("C1", r"cut", "the connection is closed"),
    ("C1", r"hole both .*", "nothing passes, both ways"),
    ("C1", r"hole down .*", "nothing passes from the rover to the laptop"),
    ("C1", r"hole up .*", "nothing passes from the laptop to the rover"),
    ("C2", r"stall .*", "everything is kept and comes late, all at once"),
    ("C2", r".* s late|jitter .*", "every message is late, or irregularly late"),
    ("C3", r".* % lost", "messages are lost at random"),
    ("C3", r".* % corrupted|foreign bytes", "messages are damaged, foreign bytes in between"),
    ("C3", r".* % (twice|overtaken)", "messages come twice or in another order"),
    ("C4", r"asleep .*", "the laptop sleeps"),
    ("C4", r"kill", "the program is killed"),
    ("C5", r"interrupt", "Ctrl-C"),
    ("C6", r"clock set .*", "the laptop's clock is set by an hour"),
    ("C7", r"disk full", "the laptop's disk is full"),
    ("C8", r"script (silent|stopped|error)", "the applet's script ends, with or without a word"),
    ("C8", r"script paused .*", "the applet's script pauses"),
    ("C9", r"power lost .*", "the autopilot restarts"),
    ("C10", r"RC lost \(1\)", "transmitter lost, the receiver sends no pulses"),
    ("C10", r"RC lost \(2\)", "transmitter lost, the receiver goes to preset values"),
    ("C11", r"disarmed", "the pilot disarms"),
    ("C11", r"hold", "the pilot changes the mode"),
    ("C12", r"second rover", "a second rover on the radio channel"),
)


def tables() -> dict[str, list[str]]:
    """The lines of each table by its name on the page."""
    return {
        "numbers": _numbers(),
        "matrix": _matrix(),
        "applet": _applet(),
        "firmware": _scenarios(),
        "stopping": _stopping(),
    }


def written(page: str) -> str:
    """The page with its tables as they follow from the tests."""
    for name, lines in tables().items():
        block = "\n".join([f"<!-- {name} -->", "", *lines, "", f"<!-- end of {name} -->"])
        page, count = re.subn(
            rf"<!-- {name} -->\n.*?<!-- end of {name} -->", lambda _, new=block: new, page, flags=re.DOTALL
        )
        assert count == 1, f"{PAGE.name} has {count} places for the table {name}"
    return page


def cause_of(fault: str) -> tuple[str, str]:
    """(cause, words) of a fault of the matrix. KeyError for one that is in no cause or in several."""
    found = [(cause, words) for cause, pattern, words in CAUSES if re.fullmatch(pattern, fault)]
    if len(found) != 1:
        raise KeyError(f"the fault {fault!r} belongs to {len(found)} causes of tests/docs/safety_tables.py")
    return found[0]


def _rows(heading: Sequence[str], rows: Iterable[Sequence[object]]) -> list[str]:
    lines = [list(heading), ["---"] * len(heading), *rows]
    return [f"| {' | '.join(str(cell) for cell in line)} |" for line in lines]


def _numbers() -> list[str]:
    return _rows(
        ("what", "at most"),
        (
            ("the laptop drives on without hearing the rover", f"{HEARD:g} s"),
            ("the laptop drives on without the applet's state", f"{REPORTED:g} s"),
            ("the laptop holds the throttle until the speed is right", f"{WAITING:g} s"),
            ("the applet waits for the laptop's next override, before HOLD", f"{OVERRIDE_HOLDS:g} s"),
            (f"the last override holds (`{OVERRIDE_TIME}`, set for a run)", f"{LAPSE:g} s"),
            ("the order to disarm is repeated", f"{INSISTS:g} s"),
            ("matrix: throttle or switch sent after the rover was last heard", f"{MAY_BE_LATE:g} s"),
            ("matrix: driven after that, while it could be reached", f"{MAY_BE_LATE + WINDS_DOWN:g} s"),
            (
                "matrix: driven outside the manoeuvre, the wait for HOLD included",
                f"{MAY_BE_LATE + WINDS_DOWN + OVERRIDE_HOLDS:g} s",
            ),
            (
                "matrix: driven while waiting for speed, the same included",
                f"{WAITING_LIMIT + MAY_BE_LATE + WINDS_DOWN + OVERRIDE_HOLDS:g} s",
            ),
        ),
    )


def _matrix() -> list[str]:
    kinds: dict[tuple[str, str, bool], list[Case]] = {}
    for case in CASES.values():
        kinds.setdefault((*cause_of(case.fault.name), case.benign), []).append(case)
    order = [(cause, words) for cause, _, words in CAUSES]
    rows = [
        (
            cause,
            words,
            "the same, and completes" if benign else "keeps the promises",
            *_by_phase(cases),
            len(cases),
        )
        for (cause, words, benign), cases in sorted(
            kinds.items(), key=lambda item: (order.index(item[0][:2]), not item[0][2])
        )
    ]
    rows.append(("", "all", "", *_by_phase(list(CASES.values())), len(CASES)))
    return _rows(("cause", "fault that begins in the phase", "the run", *PHASES, "all"), rows)


def _by_phase(cases: Sequence[Case]) -> list[object]:
    counts = [sum(case.phase == phase for case in cases) for phase in PHASES]
    return [count or "" for count in counts]


def _applet() -> list[str]:
    return _rows(
        ("condition", "the applet says", "looked at"),
        (
            (name, f"`{said}`", "while it steers" if name in STEERED else "from the switch on")
            for name, (_, said, _) in CONDITIONS.items()
        ),
    )


def _scenarios() -> list[str]:
    return _rows(
        ("fault on the official firmware", "driven on for at most", "the program says"),
        (
            (
                s.name,
                f"{_driven(s):g} s" if s.fault else "",
                f"`{s.told}`".replace("|", "` or `") if s.told else "nothing: it is dead",
            )
            for s in SCENARIOS
        ),
    )


def _driven(scenario: Any) -> float:
    from firmware_faults import MAY_BE_LATE, OVERRIDE_HOLDS, WINDS_DOWN

    return scenario.drives + MAY_BE_LATE + WINDS_DOWN + (OVERRIDE_HOLDS if scenario.lapses else 0.0)


def _stopping() -> list[str]:
    back = [{act.__name__: within for act, _, within in _cases(test)} for test in (steering, motor)]
    names = list(dict.fromkeys(name for times in back for name in times))
    return _rows(
        ("act", "steering is back within", "motor is back within"),
        ((n.replace("_", " "), *(f"{t[n]:g} s" if n in t else "" for t in back)) for n in names),
    )


def _cases(test: Any) -> Any:
    (mark,) = (mark for mark in test.pytestmark if mark.name == "parametrize")
    return mark.args[1]


if __name__ == "__main__":
    PAGE.write_text(written(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
