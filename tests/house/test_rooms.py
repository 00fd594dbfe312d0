"""Which room may import which, deferred imports included; no circles; no loose files at the root.

ROOMS goes from the ground up. A room imports the rooms of its own line, and nothing else of this project.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = ("rover_sweep", "sitl", "firmware_params")
SHARED = {"errors", "system", "_version"}  # every room may import these
ROOMS: dict[str, set[str]] = {
    "firmware_params": set(),
    "sitl": set(),
    "files": set(),
    "data": {"files"},
    "manoeuvre": {"firmware_params"},
    "spectra": {"data", "manoeuvre"},
    "design": {"data", "manoeuvre", "spectra", "firmware_params"},
    "quality": {"data", "design", "spectra"},
    "logs": {"data", "files", "quality"},
    "driving": {"data", "logs", "manoeuvre"},
    "identification": {"data", "files", "quality", "spectra"},
    "diagnosis": {"data", "identification", "manoeuvre", "quality", "spectra"},
    "investigation": {"diagnosis"},
    "comparison": {"data", "diagnosis"},
    "gains": {"data", "diagnosis", "driving", "identification"},
    "season": {"comparison", "data", "diagnosis", "spectra"},
    "report": {
        "comparison",
        "data",
        "diagnosis",
        "driving",
        "files",
        "gains",
        "identification",
        "quality",
        "season",
        "spectra",
    },
    "drawing": {"data", "diagnosis", "files", "identification", "report", "spectra"},
    "vehicle": {"data", "files", "firmware_params", "logs", "manoeuvre"},
    "session": {"data", "files", "firmware_params", "logs", "manoeuvre", "sitl", "vehicle"},
    "bench": {"data", "files", "logs", "vehicle"},
    "redrive": {"data", "firmware_params", "logs", "sitl", "vehicle"},
    "twin": {"comparison", "data", "diagnosis", "logs", "redrive", "report", "sitl"},
    "study": {"data", "files", "identification", "logs", "manoeuvre", "report", "sitl", "spectra"},
    "live": {
        "data",
        "files",
        "firmware_params",
        "logs",
        "manoeuvre",
        "quality",
        "session",
        "spectra",
        "vehicle",
    },
    "api": {
        "bench",
        "comparison",
        "data",
        "design",
        "diagnosis",
        "driving",
        "drawing",
        "files",
        "firmware_params",
        "gains",
        "identification",
        "investigation",
        "logs",
        "quality",
        "report",
        "session",
        "spectra",
    },
    "batch": {"api", "data", "files", "logs", "report", "season", "spectra"},
    "tui": {"data", "design", "files", "firmware_params", "live", "manoeuvre", "session", "vehicle"},
    "cli": {
        "api",
        "batch",
        "bench",
        "comparison",
        "data",
        "design",
        "diagnosis",
        "files",
        "firmware_params",
        "gains",
        "identification",
        "live",
        "logs",
        "manoeuvre",
        "quality",
        "redrive",
        "report",
        "session",
        "sitl",
        "study",
        "tui",
        "twin",
        "vehicle",
    },
}
LOOSE = {"__init__.py", "__main__.py", "_version.py", "errors.py", "system.py"}
OUTSIDE = {
    "identification": {"pymavlink", "click", "rich", "matplotlib", "textual"},
    "diagnosis": {"pymavlink", "click", "rich", "matplotlib", "textual"},
    "investigation": {"pymavlink", "click", "rich", "matplotlib", "textual"},
    "comparison": {"pymavlink", "click", "rich", "matplotlib", "textual"},
    "season": {"pymavlink", "click", "rich", "matplotlib", "textual"},
    "batch": {"pymavlink", "click", "rich", "textual"},
    "spectra": {"pymavlink", "click", "rich", "matplotlib", "textual"},
    "report": {"pymavlink", "click", "matplotlib", "textual"},
    "drawing": {"pymavlink", "click", "rich", "textual"},
    "api": {"pymavlink", "click", "textual"},
    "tui": {"pymavlink", "click", "matplotlib", "numpy"},
}  # libraries that a room must not import

FILES = {
    ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path
    for package in PACKAGES
    for path in (ROOT / package).rglob("*.py")
}


def imported(path: Path) -> Iterator[str]:
    """Every module that a file imports, at its head or inside of functions."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def module_of(name: str) -> str | None:
    """The module of this project that holds an imported name."""
    while name not in FILES:
        if "." not in name:
            return None
        name = name.rpartition(".")[0]
    return name


ARROWS = {
    module: {found for name in imported(path) if (found := module_of(name)) and found != module}
    for module, path in FILES.items()
}


def room_of(module: str) -> str:
    parts = module.split(".")
    return parts[1] if parts[0] == "rover_sweep" and len(parts) > 1 else parts[0]


def within(module: str, depth: int) -> str:
    """The room at that depth: the folder, or the file itself where it lies higher."""
    return ".".join(module.split(".")[: depth + 1])


@pytest.mark.parametrize("room", ROOMS)
def test_a_room_imports_what_it_may(room: str) -> None:
    modules = [module for module in FILES if room_of(module) == room]
    assert modules
    allowed = {room, *SHARED, *ROOMS[room]}
    wrong = [
        f"{module} -> {target}"
        for module in modules
        for target in ARROWS[module]
        if room_of(target) not in allowed
    ]
    assert not wrong
    used = {room_of(target) for module in modules for target in ARROWS[module]} - {room, *SHARED}
    assert used == ROOMS[room], "an allowed import that is no longer used"


@pytest.mark.parametrize("room", OUTSIDE)
def test_a_room_does_without_these_libraries(room: str) -> None:
    wrong = [
        f"{module} -> {name}"
        for module, path in FILES.items()
        if room_of(module) == room
        for name in imported(path)
        if name.partition(".")[0] in OUTSIDE[room]
    ]
    assert not wrong


def test_methods_that_are_imported_when_called_exist() -> None:
    """`drawing("draw_run")` in data, spectra and identification: the arrow that no import shows."""
    called = {
        (node.args[0].value, module)
        for module, path in FILES.items()
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "drawing"
        if isinstance(node.args[0], ast.Constant)
    }
    assert {room_of(module) for _, module in called} == {"data", "spectra", "identification"}
    source = FILES["rover_sweep.drawing.drawn"].read_text()
    for name, module in called:
        assert f"\ndef {name}(" in source, f"{module} calls {name}, which is not there"


@pytest.mark.parametrize("depth", [1, 2, 3, 9])
def test_no_circle_between_rooms_of_any_depth(depth: int) -> None:
    graph: dict[str, set[str]] = {}
    for module, targets in ARROWS.items():
        if module == "rover_sweep":
            continue  # it only re-exports names
        own = within(module, depth)
        graph.setdefault(own, set()).update(within(t, depth) for t in targets if t != "rover_sweep")
    for room, targets in graph.items():
        targets.discard(room)
    TopologicalSorter(graph).prepare()  # CycleError names the circle


def test_nothing_is_loose_at_the_root() -> None:
    assert {path.name for path in (ROOT / "rover_sweep").glob("*.py")} == LOOSE
    folders = {path.name for path in (ROOT / "rover_sweep").iterdir() if (path / "__init__.py").exists()}
    assert folders == {room for room in ROOMS if room not in PACKAGES}


def test_every_room_says_what_it_is() -> None:
    lacking = [
        str(path.relative_to(ROOT))
        for path in FILES.values()
        if path.name == "__init__.py" and not ast.get_docstring(ast.parse(path.read_text()))
    ]
    assert not lacking
