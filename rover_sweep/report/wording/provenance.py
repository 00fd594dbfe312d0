"""Provenance of a report: vehicle file, verification runs, command, versions."""

from __future__ import annotations

import hashlib
import importlib.metadata
import platform
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path

from rover_sweep._version import __version__
from rover_sweep.data.recording import Recording
from rover_sweep.data.vehicle_file import Vehicle


def versions() -> dict[str, str]:
    """Versions of the packages that computed the numbers."""
    packages = {name: importlib.metadata.version(name) for name in ("numpy", "scipy")}
    return {"rover_sweep": __version__, **packages, "python": platform.python_version()}


@dataclass(frozen=True, eq=False)
class Provenance:
    """Origin of a result.

    vehicle: the rover as in its file; vehicle_source: (name, sha256) of that file.
    verify_runs: the recordings of the verification, in the order of the identification's verdicts.
    command: the command line; made: when, ISO 8601, "" to leave it out.
    """

    vehicle: Vehicle | None = None
    vehicle_source: tuple[str, str] | None = None
    verify_runs: tuple[Recording, ...] = ()
    command: str = ""
    made: str = ""
    versions: dict[str, str] = field(default_factory=versions)


def provenance(
    vehicle: Vehicle | None = None,
    vehicle_file: Path | None = None,
    verify_runs: Sequence[Recording] = (),
    command: str = "",
    now: datetime | None = None,
) -> Provenance:
    """A Provenance; reads the vehicle file for its hash. now: time of the report, with time zone."""
    source = None
    if vehicle_file is not None:
        source = vehicle_file.name, hashlib.sha256(vehicle_file.read_bytes()).hexdigest()
    made = now.isoformat(timespec="seconds") if now else ""
    return Provenance(vehicle, source, tuple(verify_runs), command, made)
