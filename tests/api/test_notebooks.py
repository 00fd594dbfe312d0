"""The notebooks run as they are, one cell after the other, and are committed without outputs."""

from __future__ import annotations

import ast
from pathlib import Path
from typing import Any

import matplotlib
import nbformat
import pytest

NOTEBOOKS = Path(__file__).parents[2] / "docs" / "notebooks"
FOLDER = sorted(NOTEBOOKS.glob("*.ipynb"))


def run(cell: str, names: dict[str, Any], where: str) -> str:
    """Runs a cell as a notebook does; what it displays: the value of its last line, unless it ends in `;`."""
    parsed = ast.parse(cell, where)
    last = parsed.body[-1]
    shown = isinstance(last, ast.Expr) and not cell.rstrip().endswith(";")
    head = ast.Module(parsed.body[:-1] if shown else parsed.body, [])
    exec(compile(head, where, "exec"), names)
    if not (shown and isinstance(last, ast.Expr)):
        return ""
    value = eval(compile(ast.Expression(last.value), where, "eval"), names)
    html = getattr(value, "_repr_html_", None)
    return html() if html else repr(value)


def test_both_notebooks_are_there() -> None:
    assert [path.stem for path in FOLDER] == ["identify", "left_out"]


@pytest.mark.parametrize("path", FOLDER, ids=lambda path: str(path.stem))
def test_a_notebook_is_valid_and_small(path: Path) -> None:
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    assert all(not cell.get("outputs") for cell in notebook.cells)
    assert path.stat().st_size < 20_000


@pytest.mark.parametrize(
    ("name", "words"),
    [
        (
            "identify",
            ["2 runs of example rover", "<td>keep</td>", "roll-yaw", "Izz 0.07", "rms of the error"],
        ),
        pytest.param(
            "left_out",
            ["explained: backlash", "half of the gap, road-wheel angle", "look-alikes: none"],
            marks=pytest.mark.slow,
        ),
    ],
)
def test_a_notebook_runs(
    name: str, words: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    matplotlib.use("Agg")
    monkeypatch.chdir(NOTEBOOKS)
    before = sorted(NOTEBOOKS.rglob("*"))
    notebook, names, shown = nbformat.read(NOTEBOOKS / f"{name}.ipynb", as_version=4), {}, ""
    for k, cell in enumerate(c for c in notebook.cells if c.cell_type == "code"):
        shown += run(cell.source, names, f"{name}.ipynb, code cell {k + 1}")
    from matplotlib import pyplot

    assert len(pyplot.get_fignums()) >= 3 and all(pyplot.figure(n).axes for n in pyplot.get_fignums())
    pyplot.close("all")
    shown += capsys.readouterr().out
    for expected in words:
        assert expected in shown
    assert sorted(NOTEBOOKS.rglob("*")) == before, "a notebook leaves files in the checkout"
