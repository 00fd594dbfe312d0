"""Reads a user's files of model structures, for `identify --structure`."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from rover_sweep.errors import UsageError
from rover_sweep.identification.grouping import MODELS
from rover_sweep.identification.structure.state_space import ModelStructure
from rover_sweep.identification.structure.toml_form import StructureError, structure_from_text

Location = str | os.PathLike[str]


def load_structures(paths: Sequence[Location | ModelStructure]) -> tuple[ModelStructure, ...]:
    """The structures of these files. UsageError with all mistakes of a file, or when two have one name."""
    found = tuple(p if isinstance(p, ModelStructure) else _load(Path(p)) for p in paths)
    names = [*MODELS, "kinematic", *(s.name for s in found)]
    if twice := [n for i, n in enumerate(names) if n in names[:i]]:
        raise UsageError(f"a model named {twice[0]!r} exists already; rename the structure")
    return found


def _load(path: Path) -> ModelStructure:
    try:
        return structure_from_text(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(f"the structure {path} cannot be read: {error}") from None
    except StructureError as error:
        mistakes = str(error).replace("\n", "\n  ")
        raise UsageError(f"{path} is not a structure:\n  {mistakes}") from None
