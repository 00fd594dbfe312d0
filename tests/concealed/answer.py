"""The one place where the tool is asked: a set's folder in, diagnosis.json out."""

from __future__ import annotations

import contextlib
import io
import json
import os
import traceback
from pathlib import Path
from typing import Any


def diagnose(folder: Path, task: dict[str, Any], target: Path) -> str:
    """Diagnoses the runs of `folder` as `task` says and leaves target/diagnosis.json; a line on the answer.

    The command runs inside this process, one of the workers: imports and compiled code are loaded once.
    An answer that the tool failed to give is written down as such, with the reason.
    """
    from rover_sweep.cli.main import run

    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    runs = [str(folder / name) for name in task["runs"]]
    held_out = [part for name in task["hold_out"] for part in ("--hold-out", str(folder / name))]
    command = [
        "diagnose",
        *runs,
        *held_out,
        "--vehicle",
        str(folder / "rover.toml"),
        "--baseline",
        task["baseline"],
        "--out",
        str(target),
        "--json",
    ]
    if task.get("without"):
        command += ["--without", ",".join(task["without"])]
    said = io.StringIO()
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(said):
        try:
            run(command)
        except Exception:  # whatever breaks is an answer too: none
            said.write(traceback.format_exc())
    answer = target / "diagnosis.json"
    if not answer.exists():
        last = (said.getvalue().strip().splitlines() or ["no word"])[-1]
        failed: dict[str, Any] = {"verdict": "failed", "findings": [], "unknown": None, "reason": last}
        answer.write_text(json.dumps(failed), encoding="utf-8")
    (target / "stderr.txt").write_text(said.getvalue(), encoding="utf-8")
    return summary(json.loads(answer.read_text(encoding="utf-8")))


def summary(answer: dict[str, Any]) -> str:
    """The answer in a line: verdict and names, look-alikes in brackets, the reason where there is none."""
    names = [
        f"{one['effect']} ({', '.join(one['look_alikes'])})" if one["look_alikes"] else one["effect"]
        for one in answer["findings"]
    ]
    unknown = ["+ unknown"] if answer["unknown"] else []
    reason = [answer["reason"]] if "reason" in answer else []
    return " ".join([answer["verdict"], *names, *unknown, *reason])
