"""The one place where the tool is asked: a set's folder in, diagnosis.json out."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any


def diagnose(folder: Path, task: dict[str, Any], target: Path) -> str:
    """Diagnoses the runs of `folder` as `task` says and leaves target/diagnosis.json; a line on the answer.

    An answer that the tool failed to give is written down as such and graded as wrong.
    """
    runs = [str(folder / name) for name in task["runs"]]
    held_out = [part for name in task["hold_out"] for part in ("--hold-out", str(folder / name))]
    command = [sys.executable, "-m", "rover_sweep.cli.main", "diagnose", *runs, *held_out,
               "--vehicle", str(folder / "rover.toml"), "--baseline", task["baseline"], "--out", str(target),
               "--json"]  # fmt: skip
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    answer = target / "diagnosis.json"
    if not answer.exists():
        last = (done.stderr.strip().splitlines() or ["no word"])[-1]
        answer.write_text(json.dumps({"verdict": "failed", "findings": [], "unknown": None, "reason": last}))
    (target / "stderr.txt").write_text(done.stderr, encoding="utf-8")
    return summary(json.loads(answer.read_text(encoding="utf-8")))


def summary(answer: dict[str, Any]) -> str:
    """The answer in a line: verdict and names, look-alikes in brackets."""
    names = [f"{one['effect']} ({', '.join(one['look_alikes'])})" if one["look_alikes"] else one["effect"]
             for one in answer["findings"]]  # fmt: skip
    return " ".join([answer["verdict"], *names, *(["+ unknown"] if answer["unknown"] else [])])
