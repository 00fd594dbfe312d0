"""Logs by path or URL: found in folders, identified by their contents, copied to their worker."""

from __future__ import annotations

import hashlib
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rover_sweep.errors import DataRefused, UsageError, missing_extra

KINDS = (".bin", ".tlog")


def is_url(source: str) -> bool:
    """True for a URL that fsspec opens, such as s3://bucket/log.BIN."""
    return "://" in source


def log_sources(given: Sequence[str]) -> tuple[str, ...]:
    """All logs, each once, in order of their names: files as given, and those of folders and URLs with `*`.

    In folders a .tlog beside the .BIN of the same name is left out, as both are of one drive. UsageError
    where a folder holds no log.
    """
    found: dict[str, None] = {}
    for source in given:
        for name in _of_url(source) if is_url(source) else _of_path(source):
            found[name] = None
    return tuple(sorted(found))


def _of_path(source: str) -> list[str]:
    path = Path(source).expanduser()
    if not path.is_dir():
        return [str(path)]
    return _without_pairs(source, [str(p) for p in sorted(path.rglob("*")) if p.suffix.lower() in KINDS])


def _of_url(source: str) -> list[str]:
    fs, path = _opened(source)
    try:
        if "*" in path:
            return [fs.unstrip_protocol(p) for p in sorted(fs.glob(path))]
        if fs.isdir(path):
            every = [fs.unstrip_protocol(p) for p in sorted(fs.find(path))]
            return _without_pairs(source, [p for p in every if p.lower().endswith(KINDS)])
    except Exception as error:  # each file system has errors of its own
        raise UsageError(f"{source} cannot be listed: {error}") from None
    return [source]


def _without_pairs(source: str, names: Sequence[str]) -> list[str]:
    if not names:
        raise UsageError(f"{source} holds no .BIN and no .tlog; give logs or a folder with logs")
    flash = {name[:-4] for name in names if name.lower().endswith(".bin")}
    return [name for name in names if not (name.lower().endswith(".tlog") and name[:-5] in flash)]


def content_key(source: str) -> str:
    """A hash that changes with the contents: a file's sha256, what fsspec knows of a URL; "" for none."""
    try:
        if is_url(source):
            fs, path = _opened(source)
            return str(fs.ukey(path))
        with open(source, "rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except Exception:  # the sentence comes with the attempt to read it
        return ""


@contextmanager
def local_file(source: str) -> Iterator[Path]:
    """The log as a local file; of a URL a copy that is removed again. DataRefused where it cannot be read."""
    if not is_url(source):
        yield Path(source)
        return
    with tempfile.TemporaryDirectory(prefix="rover-sweep-") as folder:
        copy = Path(folder) / source.rpartition("/")[2]
        try:
            fs, path = _opened(source)
            fs.get_file(path, str(copy))
        except UsageError:
            raise
        except Exception as error:
            raise DataRefused(f"{source} cannot be read: {error or type(error).__name__}") from None
        yield copy


def _opened(source: str) -> tuple[Any, str]:
    try:
        from fsspec.core import url_to_fs
    except ImportError:
        raise missing_extra(f"{source} is a URL and needs fsspec", "fleet") from None
    try:
        fs, path = url_to_fs(source)
    except Exception as error:
        raise UsageError(f"{source} cannot be opened: {error}") from None
    return fs, str(path)
