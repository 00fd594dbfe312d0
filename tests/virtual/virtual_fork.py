"""Cases that share their beginning: it is run once, and a fork of this process goes on with each case.

    problems_of([case for case in CASES.values() if (case.phase, case.seconds) == ("sweep", 0.3)], folder)

A world with the same seed is the same up to the moment at which the fault begins. A fork has its own memory
but shares the files, which are therefore put back after each case.
"""

from __future__ import annotations

import json
import os
import traceback
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from virtual_matrix import Case
from virtual_mutants import judged, problems
from virtual_run import Outcome
from virtual_world import Fault, Killed, World


def problems_of(cases: Sequence[Case], folder: Path) -> dict[str, list[str]]:
    """`problems` of cases that differ in the fault only, by the name of the case."""
    if not hasattr(os, "fork"):
        return {case.name: problems(case, folder / str(k)) for k, case in enumerate(cases)}
    trunk = _Trunk(cases, folder)
    (first, *_) = cases
    assert {(case.phase, case.seconds, case.limit) for case in cases} == {
        (first.phase, first.seconds, first.limit)
    }
    try:
        outcome = first.played(folder, Fault("fork", trunk.fork))
        trunk.ended(outcome)
    except BaseException:
        trunk.ended(traceback.format_exc())
        raise
    return trunk.found


@dataclass
class _Trunk:
    """found: what each case gave. case, answer: in a fork, its case and the pipe for what it gives."""

    cases: Sequence[Case]
    folder: Path

    def __post_init__(self) -> None:
        self.found: dict[str, list[str]] = {}
        self.case: Case | None = None
        self.answer = -1

    def fork(self, world: World) -> None:
        """Called when the fault begins. Returns in each fork, and at last here, where the run then ends."""
        files = _Files(self.folder)
        for case in self.cases:
            read, write = os.pipe()
            if (pid := os.fork()) == 0:
                os.close(read)
                self.case, self.answer = case, write
                world.instead(case.fault)
                return
            os.close(write)
            with os.fdopen(read, encoding="utf-8") as answer:
                text = answer.read()
            os.waitpid(pid, 0)
            self.found[case.name] = json.loads(text) if text else ["the fork of this process died"]
            files.put_back()
        world.laptop.death = Killed()

    def ended(self, result: Outcome | str) -> None:
        """Ends a fork, with what came of its case."""
        if self.case is None:
            return
        try:
            wrong = [result] if isinstance(result, str) else judged(self.case, result)
            os.write(self.answer, json.dumps(wrong).encode())
        finally:
            os._exit(0)


class _Files:
    """All files in a folder, and how far those that are open have been read or written."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._content = {path: path.read_bytes() for path in self._paths()}
        inodes = {path.stat().st_ino for path in self._content}
        self._offsets = {fd: os.lseek(fd, 0, os.SEEK_CUR) for fd in _open() if os.fstat(fd).st_ino in inodes}

    def put_back(self) -> None:
        """As they were. A file that is open stays the same file."""
        for path in self._paths():
            if path not in self._content:
                path.unlink()
        for path, content in self._content.items():
            with path.open("r+b" if path.exists() else "wb") as file:
                file.write(content)
                file.truncate()
        for fd, offset in self._offsets.items():
            os.lseek(fd, offset, os.SEEK_SET)

    def _paths(self) -> list[Path]:
        return [path for path in self._folder.rglob("*") if path.is_file()]


def _open() -> list[int]:
    """File descriptors of this process."""
    found = []
    for name in os.listdir("/dev/fd"):
        try:
            os.fstat(int(name))
        except OSError:  # that of the listing itself
            continue
        found.append(int(name))
    return found
