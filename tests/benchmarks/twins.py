"""`python -m tests.benchmarks.twins DIR`: a twin of each recorded rover of a folder whose truth is known.

    python -m tests.benchmarks.twins ../shared/other_engine [--only d12,d22] [--out FOLDER]

The simulation is the nominal rover with the numbers of the vehicle file; runs 1 to 3 correct it, run 4 is
held out. Prints, for each case, the difference over the noise of both sides before and after, of the runs
used and of the one held out, with the corrections.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from math import sqrt
from pathlib import Path
from typing import Any

from tests.foreign.grade import cases, unpacked


def twin_of(path: Path, out: Path) -> dict[str, Any]:
    """twin.json of one case; RuntimeError with the command's words if it fails."""
    with unpacked(path) as (_, vehicle, paths):
        logs = [str(log) for log in paths]
        command = [sys.executable, "-m", "rover_sweep", "twin", *logs[:3], "--hold-out", logs[3]]
        command += ["--vehicle", str(vehicle), "--out", str(out / path.stem), "--json"]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"{path.stem}: {done.stderr[-400:]}")
    return json.loads(done.stdout)


def levels(one_round: Mapping[str, Any]) -> tuple[float, float]:
    """(rms over the noise of the runs that were used, of the one held out)."""
    agreement = one_round["agreement"]
    used = [a["overall"] for a in agreement if not a["held_out"]]
    (held_out,) = [a["overall"] for a in agreement if a["held_out"]]
    return sqrt(sum(x * x for x in used) / len(used)), held_out


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.twins", description=__doc__)
    parser.add_argument("folder", type=Path, help="with dNN.json beside dNN.tar.xz")
    parser.add_argument("--only", default="", help="cases, as in d12,d22")
    parser.add_argument("--out", type=Path, help="folder for the pages (default: none are kept)")
    args = parser.parse_args()
    good = worse = 0
    with tempfile.TemporaryDirectory() as scratch:
        for path in (found := cases(args.folder, args.only)):
            began = time.monotonic()
            twin = twin_of(path, args.out or Path(scratch))
            seconds = time.monotonic() - began
            (used, held), (used_after, after) = levels(twin["rounds"][0]), levels(twin["rounds"][-1])
            good += after <= 1.3
            worse += after > held * 1.02
            hidden = json.loads(path.read_text())["hidden"]
            changed = ", ".join(f"{c['entry']} {c['before']} -> {c['after']}" for c in twin["corrections"])
            print(
                f"{path.stem} {hidden}: used {used:.2f} -> {used_after:.2f}, "
                f"held out {held:.2f} -> {after:.2f}, {'agrees' if twin['agrees'] else 'differs'}, "
                f"{seconds:.0f} s; {changed or 'no correction'}",
                flush=True,
            )
    print(f"held out at most 1.3: {good} of {len(found)}; worse than before: {worse}")


if __name__ == "__main__":
    main()
