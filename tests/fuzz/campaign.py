"""Many damaged files in one go: `python -m tests.fuzz.campaign --count 100000 --seed 1`.

Each case runs in this process under a watchdog and a limit of memory. Prints each new mistake with its
traceback and a command that repeats it, at the end (or at SIGTERM) the table; the exit code is 1
where there was any.
"""

from __future__ import annotations

import argparse
import faulthandler
import os
import resource
import signal
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: its threads count as memory

from tests.fuzz.cases import KINDS, Kind, WrongModel, case, right_models, undamaged

PATIENCE = 30.0  # s of computing for a case
ASLEEP = 240.0  # s in all
MEMORY = 1 << 30  # bytes that a case may take beyond what the program has
STUCK = 600.0  # s after which even a call that no signal interrupts ends the program


class Hang(BaseException):
    """The watchdog: no `except Exception` of the program under test may swallow it."""


@dataclass
class Row:
    """Outcomes of one kind."""

    outcomes: Counter[str] = field(default_factory=Counter)
    slowest: float = 0.0


@dataclass
class Campaign:
    """All outcomes, and each mistake once, by the place that raised it."""

    rows: dict[str, Row]
    mistakes: dict[str, str] = field(default_factory=dict)


def _barked(number: int, frame: FrameType | None) -> None:
    raise Hang(f"no answer within {PATIENCE:.0f} s of computing, or {ASLEEP:.0f} s in all")


@contextmanager
def watchdog() -> Iterator[None]:
    """Raises Hang in the main thread after `PATIENCE` of computing, or after `ASLEEP` in all: a machine that
    is busy with other work makes no hang. Ends the program where that does not help."""
    timers = ((signal.SIGPROF, signal.ITIMER_PROF, PATIENCE), (signal.SIGALRM, signal.ITIMER_REAL, ASLEEP))
    before = {number: signal.signal(number, _barked) for number, _, _ in timers}
    faulthandler.dump_traceback_later(STUCK, exit=True)
    try:
        for _, timer, seconds in timers:
            signal.setitimer(timer, seconds)
        yield
    finally:
        for number, timer, _ in timers:
            signal.setitimer(timer, 0)
            signal.signal(number, before[number])
        faulthandler.cancel_dump_traceback_later()


def limit_memory() -> None:
    """What is asked for beyond `MEMORY` more than now raises MemoryError."""
    now = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (now + MEMORY, hard))


def outcome(kind: Kind, folder: Path, seed: str) -> tuple[str, str]:
    """(outcome, traceback) of one case."""
    try:
        with watchdog():
            return case(kind, folder, seed), ""
    except WrongModel:
        return "wrong model", traceback.format_exc()
    except Hang:
        return "hang", traceback.format_exc()
    except MemoryError:
        return "memory", traceback.format_exc()
    except Exception:
        return "traceback", traceback.format_exc()


def place(said: str) -> str:
    """Where a mistake was raised: the last line of the project, and the error's name."""
    own = [line.strip() for line in said.splitlines() if "rover_sweep/" in line or "sitl/" in line]
    return f"{own[-1] if own else ''} {said.strip().splitlines()[-1].split(':')[0]}"


def campaign(kinds: Sequence[Kind], numbers: Sequence[int], seed: int) -> Campaign:
    """The kinds in turn, a case for each number; what was done where it is interrupted."""
    done = Campaign({kind.name: Row() for kind in kinds})
    with tempfile.TemporaryDirectory() as folder, suppress(KeyboardInterrupt):
        for number in numbers:
            _one(done, kinds[number % len(kinds)], Path(folder), seed, number)
    return done


def _one(done: Campaign, kind: Kind, folder: Path, seed: int, number: int) -> None:
    begun = time.monotonic()
    how, said = outcome(kind, folder, f"{seed}/{number}")
    took, row = time.monotonic() - begun, done.rows[kind.name]
    row.outcomes[how] += 1
    row.slowest = max(row.slowest, took)
    if said and (where := f"{how}: {place(said)}") not in done.mistakes:
        done.mistakes[where] = said
        print(
            f"---- {where}\npython -m tests.fuzz.campaign --seed {seed} --only {number}\n{said}", flush=True
        )


def _interrupted(number: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt


COLUMNS = ("answer", "refused", "traceback", "hang", "memory", "wrong model")


def table(done: Campaign) -> str:
    """One line for each kind, and the sum."""
    heading = f"{'kind':14}{'inputs':>9}" + "".join(f"{name:>13}" for name in COLUMNS) + f"{'slowest':>10}"
    lines = [heading]
    total: Counter[str] = Counter()
    for name, row in done.rows.items():
        total += row.outcomes
        lines.append(_line(name, row.outcomes) + f"{row.slowest:9.2f} s")
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    lines.append(_line("all", total) + f"{max(row.slowest for row in done.rows.values()):9.2f} s")
    return "\n".join([*lines, f"peak memory of the whole program: {peak:.0f} MB"])


def _line(name: str, outcomes: Counter[str]) -> str:
    return f"{name:14}{outcomes.total():9d}" + "".join(f"{outcomes[name]:13d}" for name in COLUMNS)


def main(arguments: Sequence[str] | None = None) -> int:
    """Exit code 1 where a case was neither answered nor refused."""
    asked = _asked(arguments)
    kinds = [kind for kind in KINDS if asked.kind in (None, kind.name)]
    for kind in KINDS:
        undamaged(kind.name)  # imports and models are not to count as those of the first case
        if kind.whole is not None:
            right_models(kind.name)
    limit_memory()
    signal.signal(signal.SIGTERM, _interrupted)
    numbers = [asked.only] if asked.only is not None else range(asked.first, asked.first + asked.count)
    done = campaign(KINDS if asked.only is not None else kinds, numbers, asked.seed)
    print(table(done))
    return 1 if done.mistakes else 0


def _asked(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=2000, help="how many cases")
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kind", choices=[kind.name for kind in KINDS], help="this kind alone")
    parser.add_argument("--only", type=int, help="repeat the case of this number")
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())
