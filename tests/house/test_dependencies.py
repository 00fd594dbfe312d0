"""Each package that is imported is declared: of the product in its dependencies or an extra, of tests in
`test`."""

from __future__ import annotations

import ast
import re
import sys
import tomllib
from collections.abc import Iterator
from functools import cache
from importlib.metadata import packages_distributions
from pathlib import Path

ROOT = Path(__file__).parents[2]
OURS = {"rover_sweep", "sitl", "firmware_params", "tests", "rover_twin"}  # the last one is written by a test
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def imported(folder: str) -> Iterator[tuple[str, str]]:
    """(top-level package, file) of each import of a module that is not ours."""
    ours = OURS | {p.stem for p in (ROOT / "tests").rglob("*.py")}
    for path in sorted((ROOT / folder).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
                names.append(node.module)
            for top in {name.partition(".")[0] for name in names} - ours:
                if top not in sys.stdlib_module_names:
                    yield top, str(path.relative_to(ROOT))


@cache
def distributions() -> dict[str, set[str]]:
    """{import name: normalised names of the installed packages that have it}."""
    return {name: set(map(_normal, found)) for name, found in packages_distributions().items()}


def _normal(name: str) -> str:
    return re.sub(r"[-_.]+", "-", re.split(r"[\s\[<>=!~;]", name, maxsplit=1)[0]).lower()


def undeclared(folders: tuple[str, ...], declared: list[str]) -> dict[str, str]:
    """{imported package: a file} of those that are not declared, by the name in which they are installed."""
    known = set(map(_normal, declared))
    return {
        top: path
        for folder in folders
        for top, path in imported(folder)
        if not distributions().get(top, {_normal(top)}) & known
    }


def test_the_product_declares_what_it_imports():
    extras = PROJECT["optional-dependencies"]
    declared = PROJECT["dependencies"] + [p for name, some in extras.items() if name != "test" for p in some]
    assert undeclared(("rover_sweep", "sitl", "firmware_params"), declared) == {}


def test_the_tests_declare_what_they_import():
    assert undeclared(("tests",), PROJECT["dependencies"] + PROJECT["optional-dependencies"]["test"]) == {}


def test_an_import_that_is_not_declared_is_seen():
    without = [p for p in PROJECT["dependencies"] if _normal(p) != "fastcrc"]
    assert "fastcrc" in undeclared(("rover_sweep",), without)
