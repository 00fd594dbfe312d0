"""`python -m tests.engines`: rovers whose physics was written by somebody else, diagnosed and graded.

Either drawn, of several physics engines (the one named foreign is the plant of `tests.foreign`), or recorded
(--shared DIR: cNN.json beside cNN.tar.xz). Every line has the truth, with the visibility of each effect in
brackets, and the answer. --cache keeps the drawn sets, so that several versions of the diagnosis answer the
same ones.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

from rover_sweep.diagnosis.posterior import infer
from tests.engines.draw import KINDS, BenchSet, drawn_set
from tests.engines.engine import MODULES, engine
from tests.engines.judge import Judged, judged, reliability, table
from tests.foreign.grade import PLACES, answered, diagnosed_cases, line

Wanted = tuple[str, str, int, Path | None]


def main() -> None:
    args = _arguments()
    if args.read:
        _show(list(_kept(args.read)))
        return
    if args.every_finding:
        infer.SURE = infer.SHARE  # before the processes of --jobs are forked
    names = tuple(MODULES) if args.engine == "all" else (args.engine,)
    kinds = tuple(KINDS) if args.kind == "all" else (args.kind,)
    seeds = range(args.seed, args.seed + args.sets)
    wanted = [(name, kind, seed, args.cache) for name in names for kind in kinds for seed in seeds]
    if args.draw_only:
        for one in wanted:
            started = time.monotonic()
            drawn = drawn_set(*one)
            print(f"{words(drawn)}  {time.monotonic() - started:.1f} s", flush=True)
        return
    found: list[Judged] = []
    try:
        for drawn_words, truth, result, answer in (
            _recorded(args) if args.shared else _results(wanted, args.jobs)
        ):
            print(f"{result.engine} {result.kind} {line(result.marks, answer, drawn_words)}", flush=True)
            found.append(result)
            if args.json:
                with args.json.open("a") as out:
                    out.write(json.dumps({"mark": result.marks.mark, **truth, **answer}) + "\n")
    finally:  # an interrupted bench shows what it has
        _show(found)


def _show(found: list[Judged]) -> None:
    print(table(found))
    print(f"\n{reliability(found)}")


def _kept(paths: list[Path]) -> Iterator[Judged]:
    """Answers of --json FILE, marked again."""
    for path in paths:
        for text in path.read_text().splitlines():
            one = json.loads(text)
            yield judged(one, one, engine(one["engine"]).places if one["engine"] in MODULES else PLACES)


def _results(wanted: list[Wanted], jobs: int) -> Iterator[tuple[str, dict[str, Any], Judged, dict[str, Any]]]:
    if jobs == 1:
        yield from map(_one, wanted)
        return
    with ProcessPoolExecutor(jobs) as pool:
        yield from pool.map(_one, wanted)


def _recorded(args: argparse.Namespace) -> Iterator[tuple[str, dict[str, Any], Judged, dict[str, Any]]]:
    for truth, answer, truth_words in diagnosed_cases(args.shared, args.only):
        yield truth_words, truth, judged(truth, answer, PLACES), answer


def _one(wanted: Wanted) -> tuple[str, dict[str, Any], Judged, dict[str, Any]]:
    drawn = drawn_set(*wanted)
    answer = answered(drawn.runs, drawn.held_out)
    return words(drawn), drawn.truth, judged(drawn.truth, answer, engine(drawn.engine).places), answer


def words(drawn: BenchSet) -> str:
    """Engine, kind, size of the rover, and each hidden effect with its form, value and visibility."""
    effects = (
        f"{h['effect']} [{h['form']}] {h['value']:.3g} {h['unit']} ({h['visibility']:.2g})"
        for h in drawn.truth["hidden"]
    )
    return f"{drawn.truth['size']}: " + (", ".join(effects) or "none")


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tests.engines", description=__doc__)
    parser.add_argument("--engine", choices=[*MODULES, "all"], default="all", help="default all")
    parser.add_argument("--kind", choices=[*KINDS, "all"], default="all", help="kind of set (default all)")
    parser.add_argument("--sets", type=int, default=10, help="sets of each kind (default 10)")
    parser.add_argument("--seed", type=int, default=1, help="of the first set; the others follow (default 1)")
    parser.add_argument("--jobs", type=int, default=1, help="sets at a time")
    parser.add_argument("--cache", type=Path, metavar="DIR", help="keep drawn sets here and read them again")
    parser.add_argument("--draw-only", action="store_true", help="print what is concealed, diagnose nothing")
    parser.add_argument("--shared", type=Path, metavar="DIR", help="recorded rovers instead of drawn ones")
    parser.add_argument("--only", default="", help="cases of --shared, as in c12,c13")
    parser.add_argument("--json", type=Path, metavar="FILE", help="append a JSON line for each set")
    parser.add_argument("--every-finding", action="store_true", help="name unsure ones too")
    parser.add_argument(
        "--read",
        type=Path,
        nargs="+",
        metavar="FILE",
        help="mark answers of --json again and print the tables",
    )
    return parser.parse_args()


if __name__ == "__main__":
    main()
