"""The examples in the docstrings of the public API run, and every public name has one."""

from __future__ import annotations

import ast
import doctest
import inspect
from pathlib import Path
from typing import Any

import matplotlib
import nbformat
import pytest
from docstring_examples import Examples, examples, public

import rover_sweep as rs
from rover_sweep.api.read import Runs
from rover_sweep.data.recording import Recording
from rover_sweep.identification.model_results import ModelResult
from rover_sweep.spectra.response import FrequencyResponse

WITHOUT = {  # public functions and methods without an example, each with the reason
    "compare": "needs the recordings of a simulator",
    "Harmonics": "see `harmonics`",
    "DataRefused": "an error",
    "RoverSweepError": "an error",
    "UsageError": "an error",
}
SHOWN = (Runs, Recording, FrequencyResponse, ModelResult)
SHOWN += (rs.Result, rs.FullDiagnosis, rs.Simulation, rs.SpeedIdentification)  # type: ignore[assignment]


@pytest.mark.parametrize("example", examples(), ids=lambda example: str(example.name))
def test_an_example_of_a_docstring(example: doctest.DocTest, done: Examples) -> None:
    if example.name not in done.said:
        done.run(example)
    assert not done.said[example.name], done.said[example.name]


def test_every_public_name_has_an_example() -> None:
    names = {test.name for test in examples()}
    lacking = {n for n in public() if n not in WITHOUT and not any(t.partition(".")[0] == n for t in names)}
    assert lacking == set()
    for shown in SHOWN:
        for method in ("plot", "to_frame"):
            own = getattr(shown, method)
            assert ">>>" in (inspect.getdoc(own) or ""), f"{shown.__name__}.{method}"


# ---- The notebooks run as they are, one cell after the other, and are committed without outputs.

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


def test_the_notebooks_are_valid_and_small() -> None:
    assert [path.stem for path in FOLDER] == ["identify", "left_out"]
    for path in FOLDER:
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
    name: str,
    words: list[str],
    result: rs.Result,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    matplotlib.use("Agg")
    monkeypatch.chdir(NOTEBOOKS)
    if name == "identify":
        monkeypatch.setattr(rs, "identify", lambda runs: result)  # of the same runs
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
