"""A variant of the simulated rover as an FMU (FMI 2.0, co-simulation), built by pythonfmu.

pythonfmu packs Python source with a compiled shell for Linux and Windows (64 bits); it needs no compiler. The
FMU runs in the Python that is installed where it is used.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Sequence
from hashlib import sha256
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path

from sitl.plant.variant import PlantParameters
from sitl.twin.python_file import python_file


def can_build() -> bool:
    """Whether pythonfmu is installed."""
    return find_spec("pythonfmu") is not None


def fmu_file(parameters: PlantParameters, origin: Sequence[str], name: str) -> bytes:
    """The content of `name`.fmu. origin: lines on where the numbers come from. RuntimeError if it fails."""
    rover = python_file(parameters, origin)
    # all FMUs in a process share its modules, so each rover has a module name of its own
    own = sha256(rover.encode()).hexdigest()[:12]
    with tempfile.TemporaryDirectory() as folder:
        twin, slave = (Path(folder) / f"{stem}_{own}.py" for stem in ("rover_twin", "rover_fmu"))
        twin.write_text(rover, encoding="utf-8")
        slave.write_text(_slave(name, twin.stem), encoding="utf-8")
        return _built(slave, twin, Path(folder) / "built" / f"{name}.fmu")


def _slave(name: str, rover_module: str) -> str:
    text = files("sitl.twin").joinpath("fmu_slave.py").read_text("utf-8")
    for old, new in (
        ("from sitl.twin.rover import", f"from {rover_module} import"),
        ('MODEL_NAME = "rover_twin"', f"MODEL_NAME = {name!r}"),
    ):
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    return text


def _built(slave: Path, rover: Path, target: Path) -> bytes:
    """By a process of its own: pythonfmu imports both files."""
    target.parent.mkdir()
    words = ["build", "-f", str(slave), "-d", str(target), str(rover)]
    done = subprocess.run([sys.executable, "-m", "pythonfmu", *words], capture_output=True, text=True)
    if done.returncode or not target.is_file():
        last = (done.stderr.strip() or done.stdout.strip() or "no message").splitlines()[-1]
        raise RuntimeError(f"pythonfmu could not build the FMU: {last}")
    return target.read_bytes()
