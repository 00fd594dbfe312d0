"""Scripts, modules, tests and files of the checkout that the pages name exist, with the options printed."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from printed_pages import DOCS, PAGES, ROOT

ROOMS = "tests|docs|rover_sweep|sitl|firmware_params"
NAMED = [*PAGES, ROOT / "SECURITY.md", *sorted((DOCS / "notebooks").glob("*.ipynb"))]
ELSEWHERE = {"rover_twin.py"}  # written by a command of the page


def text_of(page: Path) -> str:
    text = page.read_text(encoding="utf-8")
    return (
        "".join(s for c in json.loads(text)["cells"] for s in c["source"]) if ".ipynb" in page.name else text
    )


def python_calls(text: str) -> list[tuple[str, list[str]]]:
    """(script or module, words after it) of the calls of python in a text, inline ones over two lines too."""
    block = r"^```.*?^```"
    blocks = [line for b in re.findall(block, text, re.DOTALL | re.MULTILINE) for line in b.splitlines()]
    inline = re.findall(r"`([^`]+)`", re.sub(block, "", text, flags=re.DOTALL | re.MULTILINE))
    lines = " ; ".join(line.split("#")[0] for line in (*blocks, *inline))
    found = re.findall(r"\bpython3? (?:-m )?([\w./]+)([^;&]*)", " ".join(lines.split()))
    return [(name, rest.replace("[", " ").replace("]", " ").split()) for name, rest in found]


def source_of(name: str) -> Path | None:
    """The file of a script or of a module of the checkout; None of a module from elsewhere."""
    if name.endswith(".py"):
        return ROOT / name
    if not re.match(rf"({ROOMS})\b", name):
        return None
    path = ROOT / name.replace(".", "/")
    return path / "__main__.py" if path.is_dir() else path.with_suffix(".py")


def faults(text: str) -> list[str]:
    """What a text names and the checkout lacks."""
    named = set(re.findall(rf"(?<![\w./~-])((?:{ROOMS})/[\w./-]*\w)(?![\w*])", text))
    missing = [name for name in named if "NAME" not in name and not (ROOT / name).exists()]
    bare = set(re.findall(r"`(test_\w+\.py)`", text))
    missing += [name for name in bare if not any((ROOT / "tests").rglob(name))]
    for name, words in python_calls(text):
        source = source_of(name)
        if source is None or name in ELSEWHERE:
            continue
        if not source.is_file():
            missing.append(name)
            continue
        code = source.read_text(encoding="utf-8")
        options = (w.split("=")[0] for w in words if w.startswith("--"))
        missing += [f"{option} of {name}" for option in options if f'"{option}"' not in code]
    return missing


@pytest.mark.parametrize("page", NAMED, ids=lambda page: page.name)
def test_what_a_page_names_exists(page: Path) -> None:
    assert faults(text_of(page)) == []


def test_a_command_that_does_not_exist_is_noticed() -> None:
    text = (
        "`python -m tests.benchmarks.gone`, `python\ntests/benchmarks/all.py\n--gone 1`, `tests/data/gone/`"
        "\n```sh\npython docs/gone.py # comment\n```\n`test_gone.py`"
    )
    assert sorted(faults(text)) == [
        "--gone of tests/benchmarks/all.py",
        "docs/gone.py",
        "docs/gone.py",
        "test_gone.py",
        "tests.benchmarks.gone",
        "tests/data/gone",
    ]


def test_commands_are_found() -> None:
    assert sum(len(python_calls(text_of(page))) for page in NAMED) > 30
