"""The experiment: sets written, each diagnosed with its truth unopened, then all of them graded.

Folder: sets/NNNN (runs, rover.toml, task.json), answers/NNNN (diagnosis.json, seconds.json), truth/NNNN.json.
"""

from __future__ import annotations

import json
import multiprocessing
import shutil
import tempfile
import time
from functools import partial
from pathlib import Path
from typing import Literal

from tests.concealed.answer import diagnose
from tests.concealed.detectable import Sizes, sizes
from tests.concealed.grade import Graded, grade
from tests.concealed.sets import Kind, draw_case, kinds, write_set
from tests.concealed.summary import print_summary


def generate(
    out: Path,
    count: int,
    seed: int,
    kind: Kind | Literal["all"],
    factor: float,
    effect: str | None,
    jobs: int,
) -> list[Path]:
    """Writes `count` sets of `seed` below `out`; returns their folders."""
    tasks = [(number, of) for number, of in enumerate(kinds(count, seed, kind, effect), start=1)]
    write = partial(_write, out, seed, factor, effect)
    if jobs == 1:
        return [write(task) for task in tasks]
    with multiprocessing.get_context("spawn").Pool(jobs) as pool:
        return pool.map(write, tasks, chunksize=1)


def _write(out: Path, seed: int, factor: float, effect: str | None, task: tuple[int, Kind]) -> Path:
    number, kind = task
    folder = out / "sets" / f"{number:04d}"
    known = _sizes(seed, number) if kind in ("single", "double") else None
    case = draw_case(seed, number, kind, factor, effect, known)
    write_set(case, folder, out / "truth" / f"{number:04d}.json")
    return folder


def _sizes(seed: int, number: int) -> Sizes:
    """Detectable sizes of the plan of a set, from the same rover with nothing hidden."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "set"
        write_set(draw_case(seed, number, "none"), folder, Path(place) / "truth.json")
        return sizes(folder)


def diagnose_sets(out: Path, folders: list[Path], jobs: int, keep: bool, deleted: bool = False) -> None:
    """Lets the tool answer each set into answers/; removes the logs afterwards unless they are kept.

    deleted: with what is concealed deleted from the library of the tool.
    """
    if deleted:
        for folder in folders:
            _delete(out / "truth" / f"{folder.name}.json", folder / "task.json")
    answer = partial(_answer, out / "answers", keep)
    with multiprocessing.get_context("spawn").Pool(jobs, maxtasksperchild=40) as pool:
        for k, line in enumerate(pool.imap_unordered(answer, folders, chunksize=1), start=1):
            print(f"[{k}/{len(folders)}] {line}", flush=True)


def _delete(truth: Path, task: Path) -> None:
    """Deletes what is concealed from the library with which a set is diagnosed, and marks its truth so."""
    known = json.loads(truth.read_text(encoding="utf-8"))
    asked = json.loads(task.read_text(encoding="utf-8"))
    asked["without"] = [one["effect"] for one in known["effects"]]
    task.write_text(json.dumps(asked), encoding="utf-8")
    truth.write_text(json.dumps({**known, "kind": "deleted"}), encoding="utf-8")


def _answer(answers: Path, keep: bool, folder: Path) -> str:
    target = answers / folder.name
    target.mkdir(parents=True, exist_ok=True)
    began = time.monotonic()
    said = diagnose(folder, json.loads((folder / "task.json").read_text(encoding="utf-8")), target)
    seconds = time.monotonic() - began
    (target / "seconds.json").write_text(json.dumps(seconds), encoding="utf-8")
    if not keep:
        shutil.rmtree(folder)
    return f"{folder.name} {seconds:5.1f} s  {said}"


def report(out: Path) -> list[Graded]:
    """Opens the truth of every answered set, grades and prints."""
    graded = []
    for answer in sorted((out / "answers").glob("*/diagnosis.json")):
        name = answer.parent.name
        truth = json.loads((out / "truth" / f"{name}.json").read_text(encoding="utf-8"))
        seconds = json.loads((answer.parent / "seconds.json").read_text(encoding="utf-8"))
        graded.append(grade(name, truth, json.loads(answer.read_text(encoding="utf-8")), seconds))
    print_summary(graded)
    return graded
