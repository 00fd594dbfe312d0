"""`python -m tests.recordings --logs N --seed S`: are the grades of `identify` true?

Draws logs: a rover of an engine of the bench, driven in one of five ways, logged in one of fourteen profiles,
with a fault of 24 kinds or none. Asks `identify` as a user does, without a vehicle file, and counts by grade
how often the truth lies in all intervals and within 10 %, the direction is right, and the fault is named.
Half of the kinds of faults are left out of tuning and have their own rows (`tests/recordings/faults.py`).

--only K draws the log number K of the seed alone; --keep DIR keeps its files, to ask them with the tool
itself. --json FILE keeps the answers, --read FILE judges them again.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import partial
from multiprocessing import get_context
from pathlib import Path

from tests.recordings.draw import PROFILES, Wanted
from tests.recordings.faults import BY_NAME
from tests.recordings.judge import (
    Document,
    drawn_and_asked,
    figures,
    line,
    marked,
    numbers_table,
    table,
    worst,
)
from tests.recordings.pilots import PILOTS
from tests.recordings.rovers import SHARES


def main() -> None:
    args = _arguments()
    found = []
    try:
        for one in _kept(args.read) if args.read else _asked(args):
            mark = marked(one["log"], one["answer"])
            found.append(mark)
            if not args.read:
                print(line(mark), flush=True)
            if args.json:
                with args.json.open("a", encoding="utf-8") as out:
                    out.write(json.dumps(one) + "\n")
    finally:  # an interrupted bench shows what it has
        if found and args.only is None:
            for part in (table(found), numbers_table(found), worst(found, args.worst), figures(found)):
                print(f"\n{part}")


def _kept(paths: list[Path]) -> Iterator[Document]:
    for path in paths:
        for text in path.read_text(encoding="utf-8").splitlines():
            yield json.loads(text)


def _asked(args: argparse.Namespace) -> Iterator[Document]:
    """{log, answer} of each drawn log, in the order in which they are done."""
    wanted = Wanted(args.fault, args.profile, args.driving, args.engine, args.seconds)
    numbers = [args.only] if args.only is not None else list(range(args.first, args.first + args.logs))
    one = partial(drawn_and_asked, args.seed, keep=args.keep, wanted=wanted)
    if args.processes == 1:
        yield from map(one, numbers)
        return
    with ProcessPoolExecutor(args.processes, get_context("spawn")) as pool:
        for done in as_completed([pool.submit(one, number) for number in numbers]):
            yield done.result()


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tests.recordings", description=__doc__)
    parser.add_argument("--logs", type=int, default=60, help="how many (default 60)")
    parser.add_argument("--seed", type=int, default=1, help="of all of them (default 1)")
    parser.add_argument("--first", type=int, default=0, metavar="K", help="number of the first (default 0)")
    parser.add_argument("--only", type=int, metavar="K", help="one log by its number")
    parser.add_argument("--keep", type=Path, metavar="DIR", help="keep the files of each log in DIR")
    parser.add_argument("--processes", type=int, default=1, help="logs at a time")
    parser.add_argument("--json", type=Path, metavar="FILE", help="append a JSON line for each log")
    parser.add_argument("--read", type=Path, nargs="+", metavar="FILE", help="judge answers of --json again")
    parser.add_argument("--worst", type=int, default=5, metavar="N", help="wrong answers shown (default 5)")
    parser.add_argument("--fault", default="", choices=["none", *BY_NAME], help="this kind alone")
    parser.add_argument("--profile", default="", choices=list(PROFILES))
    parser.add_argument("--driving", default="", choices=list(PILOTS))
    parser.add_argument("--engine", default="", choices=list(SHARES))
    parser.add_argument("--seconds", type=float, default=0.0, help="length of each drive")
    return parser.parse_args()


if __name__ == "__main__":
    main()
