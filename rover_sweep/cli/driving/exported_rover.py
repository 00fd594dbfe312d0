"""The simulated rover of a diagnosis or a variant file, as it is exported to other programs."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING

from rover_sweep.errors import UsageError, missing_extra

if TYPE_CHECKING:
    from sitl.plant.variant import PlantParameters

WIDTH = 105  # of a line


@dataclass(frozen=True)
class ExportedRover:
    """Parameters, the name of the file they were read from, and what its first comments say."""

    parameters: PlantParameters
    source: str
    remarks: tuple[str, ...]

    @property
    def origin(self) -> list[str]:
        """Lines on where the numbers come from."""
        from rover_sweep._version import __version__

        first = f"Written by rover-sweep {__version__} with the numbers of {self.source}."
        return [line for words in (first, *self.remarks) for line in wrap(words, WIDTH)]


def rover_at(place: Path) -> ExportedRover:
    """Of a folder with a variant.toml (or its report/), a variant file, or a diagnosis.

    UsageError if there is none or its numbers cannot be used.
    """
    if place.is_file() and place.suffix.lower() == ".toml":
        return _read(place, place.name)
    if place.is_dir():
        for folder in (place, place / "report"):
            if (folder / "variant.toml").is_file():
                return _read(folder / "variant.toml", "variant.toml")
    return _diagnosed(place)


def rover_script(rover: ExportedRover, target: Path) -> str:
    """The rover as the source of the Python file `target`."""
    from sitl.twin.python_file import python_file

    if target.suffix != ".py" or not target.stem.isidentifier():
        raise UsageError(f"{target}: Python cannot import this name; give one such as rover_twin.py")
    return python_file(rover.parameters, rover.origin, target.stem)


def rover_fmu(rover: ExportedRover, target: Path) -> bytes:
    """The rover as the FMU file `target`; UsageError without pythonfmu."""
    from sitl.twin.fmu_file import can_build, fmu_file

    if target.suffix != ".fmu" or not target.stem.isidentifier():
        raise UsageError(f"{target}: not a name for an FMU; give letters, digits and _, as in rover_twin.fmu")
    if not can_build():
        raise missing_extra("--fmu needs pythonfmu", "fmu")
    try:
        return fmu_file(rover.parameters, rover.origin, target.stem)
    except RuntimeError as error:
        raise UsageError(str(error)) from error


def _diagnosed(place: Path) -> ExportedRover:
    from rover_sweep.api.export import diagnosis_file, read_augmented_model
    from rover_sweep.report.export.plant_variant import variant_text

    found = diagnosis_file(place)
    if found is None:
        raise UsageError(
            f"{place} holds no simulated rover; give the --out folder of diagnose, its diagnosis.json or the "
            ".toml file of a simulated rover"
        )
    model, _ = read_augmented_model(found)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "variant.toml"
        path.write_text(variant_text(model), encoding="utf-8")
        return _read(path, found.name)


def _read(path: Path, source: str) -> ExportedRover:
    """UsageError for numbers that are wrong one by one or together."""
    from sitl.plant.plant import Plant
    from sitl.plant.variant import load_variant

    try:
        parameters = load_variant(path.resolve())
        Plant(parameters)
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, ValueError) as error:
        raise UsageError(str(error)) from error
    remarks = takewhile(lambda line: line.startswith("#"), lines)
    return ExportedRover(parameters, source, tuple(line.lstrip("# ") for line in remarks))
