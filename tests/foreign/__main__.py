"""`python -m tests.foreign`: rovers whose physics was written by somebody else, diagnosed and graded.

--shared DIR: recorded rovers (cNN.json beside cNN.tar.xz).
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from tests.foreign.shared import diagnosed_cases
from tests.foreign.summary import line, table


def main() -> None:
    args = _arguments()
    graded = []
    out = args.json.open("a") if args.json else None
    for one, answer, truth in diagnosed_cases(args.shared, args.only):
        print(line(one, answer, truth), flush=True)
        graded.append(one)
        if out:
            out.write(json.dumps({"set": one.name, "hidden": one.hidden, "mark": one.mark, **answer}) + "\n")
            out.flush()
    print(table(graded))


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tests.foreign", description=__doc__)
    parser.add_argument("--shared", type=Path, metavar="DIR", required=True, help="recorded rovers")
    parser.add_argument("--only", default="", help="cases of --shared, as in c12,c13")
    parser.add_argument("--json", type=Path, metavar="FILE", help="append a JSON line for each set")
    return parser.parse_args()


if __name__ == "__main__":
    main()
