"""The vehicle files of a fleet, and which one belongs to a log.

A folder holds one file per vehicle, named after it: rover-07.toml. A log belongs to it when one of its
folders or the beginning of its own name is `rover-07`, or when fleet.toml in the same folder lists its board:

    [boards]
    rover-07 = ["CubeOrange 0028001F 3432510D 37343231"]

rover.toml in the folder is for all other logs.
"""

from __future__ import annotations

import hashlib
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from rover_sweep.data.vehicle_file import parse
from rover_sweep.errors import DataRefused, UsageError
from rover_sweep.files.documents import read_toml

EVERY, FLEET = "rover", "fleet"  # stems of the file for all other logs, and of the list of boards


@dataclass(frozen=True)
class VehicleFiles:
    """texts: {name: contents}. boards: {board: name}. beside: {folder of logs: name} of files found there."""

    texts: Mapping[str, str]
    boards: Mapping[str, str] = field(default_factory=dict)
    beside: Mapping[str, str] = field(default_factory=dict)

    def of(self, source: str, board: str) -> tuple[str, str]:
        """(name of the file, name of the vehicle or "") for a log; DataRefused where there is none."""
        if board in self.boards:
            return self.boards[board], self.boards[board]
        *folders, own = source.replace("\\", "/").split("/")
        for part in reversed(folders):
            if part in self.texts and part != EVERY:
                return part, part
        starts = [name for name in self.texts if own.startswith(name) and name != EVERY]
        if starts:
            name = max(starts, key=len)
            return name, name
        folder = "/".join(folders)
        if folder in self.beside:
            return self.beside[folder], ""
        if EVERY in self.texts:
            return EVERY, ""
        raise DataRefused(
            f"no vehicle file for {own}{f' of the board {board}' if board else ''}: give --vehicles with a "
            f"file named after its folder, with {FLEET}.toml that lists its board, or with {EVERY}.toml"
        )

    def digest(self, name: str) -> str:
        """sha256 of a file's contents, "" for none."""
        return hashlib.sha256(self.texts[name].encode()).hexdigest() if name in self.texts else ""


def read_vehicle_files(folder: Path) -> VehicleFiles:
    """All vehicle files of a folder, checked; UsageError where one is wrong."""
    paths = sorted(folder.glob("*.toml"))
    if not paths:
        raise UsageError(f"{folder} holds no vehicle file; put rover.toml or one NAME.toml per vehicle there")
    texts = {path.stem: _text(path) for path in paths}
    boards = _boards(texts.pop(FLEET, ""), folder / f"{FLEET}.toml", texts)
    for name, text in texts.items():
        parse(text, str(folder / f"{name}.toml")).steering()
    return VehicleFiles(texts, boards)


def files_beside(sources: Sequence[str]) -> VehicleFiles:
    """rover.toml in the folder of each local log, or in the folder above it."""
    texts, beside = {}, {}
    for folder in sorted({source.replace("\\", "/").rpartition("/")[0] for source in sources}):
        if "://" in folder:
            continue
        place = Path(folder or ".")
        for path in (place / f"{EVERY}.toml", place.parent / f"{EVERY}.toml"):
            if path.is_file():
                name = str(path)
                texts[name] = _text(path)
                parse(texts[name], name).steering()
                beside[folder] = name
                break
    return VehicleFiles(texts, {}, beside)


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(f"the vehicle file {path} cannot be read: {error}") from None


def _boards(text: str, path: Path, texts: Mapping[str, str]) -> dict[str, str]:
    try:
        table = read_toml(text).get("boards", {}) if text else {}
    except tomllib.TOMLDecodeError as error:
        raise UsageError(f"{path} is not valid TOML: {error}") from None
    out: dict[str, str] = {}
    for name, boards in table.items() if isinstance(table, dict) else ():
        if name not in texts:
            raise UsageError(f"{path} lists boards of {name}, but there is no {name}.toml beside it")
        if not isinstance(boards, list) or not all(isinstance(b, str) for b in boards):
            raise UsageError(
                f'{path}: the boards of {name} must be a list, as in {name} = ["CubeOrange ..."]'
            )
        for board in boards:
            if out.setdefault(board, name) != name:
                raise UsageError(f"{path} lists the board {board} for both {out[board]} and {name}")
    return out
