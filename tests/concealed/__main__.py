"""`python -m tests.concealed`: draws fresh sets, conceals, diagnoses, opens the truth and grades.

A simulated rover of its own (another integrator, tyre law, servo and log writer than the project has; it
shares no code with the tool or with `sitl`) hides an effect in field-like `.BIN` logs. Axes inside are ISO
8855, SI units; FRD and microseconds begin in `messages`. Sizes and look-alikes: sizes.toml.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

from tests.concealed.effects import UNKNOWN, ids
from tests.concealed.proof import diagnose_sets, generate, report


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tests.concealed", description=__doc__)
    parser.add_argument("--sets", type=int, default=10, help="how many sets (default 10)")
    parser.add_argument(
        "--seed", type=int, default=1, help="sets of another seed are other rovers and noises"
    )
    parser.add_argument("--kind", choices=["none", "single", "double", "unknown", "all"], default="all")
    parser.add_argument(
        "--effect", choices=[*ids(), *UNKNOWN], help="conceal this one in every set that hides one"
    )
    parser.add_argument("--factor", type=float, default=2.0, help="times the detectable size (default 2)")
    parser.add_argument("--jobs", type=int, default=1, help="sets at a time")
    parser.add_argument(
        "--out", type=Path, help="folder of sets, answers and truth (default: a temporary one)"
    )
    parser.add_argument(
        "--delete-truth", action="store_true", help="diagnose without what is concealed in the library"
    )
    parser.add_argument("--keep", action="store_true", help="keep the logs after they were diagnosed")
    parser.add_argument("--generate-only", action="store_true", help="write sets and truth, diagnose nothing")
    parser.add_argument("--grade-only", type=Path, metavar="DIR", help="grade the answers in DIR again")
    args = parser.parse_args()
    if args.delete_truth and args.kind != "single":
        parser.error("--delete-truth is for --kind single")
    if args.effect and args.kind != "all" and (args.effect in UNKNOWN) != (args.kind == "unknown"):
        parser.error(f"{args.effect} is not of the kind {args.kind}")
    return args


def main() -> None:
    args = _arguments()
    if args.grade_only:
        report(args.grade_only)
        return
    out = args.out or Path(tempfile.mkdtemp(prefix="concealed-"))
    out.mkdir(parents=True, exist_ok=True)
    folders = generate(out, args.sets, args.seed, args.kind, args.factor, args.effect, args.jobs)
    if args.generate_only:
        print(f"{len(folders)} sets in {out / 'sets'}, their truth in {out / 'truth'}")
        return
    diagnose_sets(out, folders, args.jobs, args.keep, args.delete_truth)
    report(out)


if __name__ == "__main__":
    main()
