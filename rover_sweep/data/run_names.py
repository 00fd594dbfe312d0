"""Unique names of runs whose files have equal names, as in two sessions."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from rover_sweep.data.recording import Recording


def source_names(sources: Sequence[str]) -> Mapping[str, str]:
    """{source: name}: the stem of its file, with folder or suffix where stems are equal."""
    files = {source: _file(source) for source in sources}
    same_stem: dict[str, list[str]] = {}
    for source, path in files.items():
        same_stem.setdefault(path.stem, []).append(source)
    return {s: _name(files[s], [files[o] for o in group]) for group in same_stem.values() for s in group}


def _file(source: str) -> Path:
    """The file that names the runs of a source; the .BIN of a pair."""
    parts = [source] if Path(source).is_file() else source.split("+")
    named = next((part for part in parts if part.lower().endswith(".bin")), parts[0])
    return Path(named).expanduser().resolve()


def _name(path: Path, same_stem: Sequence[Path]) -> str:
    """The shortest name that differs from those of the other files; sources of one file share it."""
    names: list[Callable[[Path], str]] = [
        lambda p: p.stem,
        lambda p: f"{p.parent.name}/{p.stem}",
        lambda p: p.name,
    ]
    names += [lambda p, n=n: "/".join(p.parts[-n:]) for n in range(2, len(path.parts) + 1)]  # type: ignore[misc]
    others = set(same_stem) - {path}
    return next((n(path) for n in names if n(path) not in {n(other) for other in others}), str(path))


def named(run: Recording, source: str, name: str) -> Recording:
    """A run renamed after its source. name: from `source_names`."""
    stem = _file(source).stem
    return run if name == stem else replace(run, name=name + run.name.removeprefix(stem))
