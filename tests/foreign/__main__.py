"""`python -m tests.foreign`: rovers whose physics was written by somebody else, diagnosed and graded.

Either drawn (--kind), by a plant that shares no law, structure or integrator with the diagnosis, or recorded
(--shared DIR: cNN.json beside cNN.tar.xz). Every line has the truth, with the visibility of each law in
brackets, and the answer.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from rover_sweep.diagnosis.posterior import infer
from tests.foreign.draw import KINDS, draw
from tests.foreign.drawn import diagnosed_sets, truth_words
from tests.foreign.grade import Graded
from tests.foreign.shared import diagnosed_cases
from tests.foreign.summary import line, table


def main() -> None:
    args = _arguments()
    if args.every_finding:
        infer.SURE = infer.SHARE  # before the processes of --jobs are forked
    kinds = tuple(KINDS) if args.kind == "all" else (args.kind,)
    seeds = range(args.seed, args.seed + args.sets)
    if args.draw_only:
        for kind in kinds:
            for seed in seeds:
                print(f"{kind} {seed} {truth_words(draw(kind, seed).truth())}", flush=True)
        return
    graded = []
    if args.shared:
        for one, answer, words in diagnosed_cases(args.shared, args.only):
            graded.append(_shown(one, answer, words, {"hidden": one.hidden}, args.json))
    else:
        for one, answer, truth in diagnosed_sets(kinds, seeds, args.jobs):
            graded.append(_shown(one, answer, truth_words(truth), truth, args.json))
    print(table(graded))


def _shown(
    one: Graded, answer: dict[str, Any], words: str, truth: dict[str, Any], path: Path | None
) -> Graded:
    print(line(one, answer, words), flush=True)
    if path:
        with path.open("a") as out:
            out.write(json.dumps({"set": one.name, "mark": one.mark, **truth, **answer}) + "\n")
    return one


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tests.foreign", description=__doc__)
    parser.add_argument("--kind", choices=[*KINDS, "all"], default="all", help="kind of set (default all)")
    parser.add_argument("--sets", type=int, default=10, help="sets of each kind (default 10)")
    parser.add_argument("--seed", type=int, default=1, help="of the first set; the others follow (default 1)")
    parser.add_argument("--jobs", type=int, default=1, help="sets at a time")
    parser.add_argument("--draw-only", action="store_true", help="print what is concealed, diagnose nothing")
    parser.add_argument("--shared", type=Path, metavar="DIR", help="recorded rovers instead of drawn ones")
    parser.add_argument("--only", default="", help="cases of --shared, as in c12,c13")
    parser.add_argument("--every-finding", action="store_true", help="name unsure ones too")
    parser.add_argument("--json", type=Path, metavar="FILE", help="append a JSON line for each set")
    return parser.parse_args()


if __name__ == "__main__":
    main()
