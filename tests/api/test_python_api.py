"""The Python API as a user meets it: README's lines, tables, bad input, saving and loading."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rover_sweep as rs

ROOT = Path(__file__).parents[2]
NOMINAL = ROOT / "tests/data/ardurover-4.6.3/nominal"
ROVER = ROOT / "tests/data/rover.toml"


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        ({"verify": "run4"}, "verify: 'run4' is no run"),
        ({"bands": {"q": (1, 2)}}, "there is no response 'q'"),
        ({"bands": "r"}, "bands is 'r'"),
        ({"bands": {"r": 3}}, r"the band of r is 3; give \(lowest, highest\)"),
        ({"band": "x"}, "band is 'x'"),
        ({"models": 3}, "there is no model 3"),
    ],
)
def test_a_wrong_argument_is_a_sentence(runs: Any, wrong: dict[str, Any], sentence: str) -> None:
    with pytest.raises(rs.UsageError, match=sentence):
        rs.identify(runs, **wrong)


def test_a_wrong_vehicle_or_path_is_a_sentence(runs: Any) -> None:
    with pytest.raises(rs.UsageError, match=r"vehicle is 3; give the path"):
        rs.read(NOMINAL / "run1.BIN", vehicle=3)  # type: ignore[arg-type]
    with pytest.raises(rs.UsageError, match=r"takes paths of files or folders, not 3"):
        rs.read(3)  # type: ignore[arg-type]
    with pytest.raises(rs.UsageError, match=r"no channel is named; choose from pwm"):
        runs["run1"].plot([])


def test_the_lines_of_the_readme_run_as_they_stand(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (block,) = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    assert len([line for line in block.splitlines() if line]) <= 10
    for name in re.findall(r'"(run\d\.BIN)"', block):
        (tmp_path / name).symlink_to(NOMINAL / name)
    (tmp_path / "rover.toml").symlink_to(ROVER)
    monkeypatch.chdir(tmp_path)
    exec(block, {})
    shown = capsys.readouterr().out
    assert "yaw inertia about the CG" in shown and "90 % interval" in shown
    assert (tmp_path / "report" / "report.html").stat().st_size > 100_000
    assert json.loads((tmp_path / "report" / "identification.json").read_text())["recommended"] == "roll-yaw"


def test_importing_costs_nothing() -> None:
    script = (
        "import sys, time; t = time.perf_counter(); import rover_sweep; s = time.perf_counter() - t;"
        "print(s, [m for m in ('numpy', 'scipy', 'matplotlib', 'pymavlink') if m in sys.modules])"
    )
    lines = [
        subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=True)
        for _ in range(3)
    ]
    seconds, loaded = min(line.stdout.split(maxsplit=1) for line in lines)
    assert float(seconds) < 0.1
    assert loaded.strip() == "[]"


def test_every_public_name_is_there_and_described() -> None:
    for name in rs.__all__:
        if name != "__version__":
            assert getattr(rs, name).__doc__, name
        assert name in dir(rs)
    with pytest.raises(AttributeError, match="no_such"):
        rs.no_such  # noqa: B018


def test_the_package_of_the_core_is_still_a_package() -> None:
    import rover_sweep.identification.fit as cost

    assert cost.POINTS == 20
    assert callable(rs.identify)


def test_runs_are_a_sequence_that_shows_itself(runs: Any) -> None:
    assert [r.kind for r in runs] == ["sweep", "doublet"]
    assert [r.name for r in runs[:1] + runs[1:]] == ["run1", "run4"]
    assert "2 runs of example rover" in repr(runs)
    assert runs.coherence()[0].keep
    assert "keep: coherence" in repr(runs.coherence()[0])
    assert len(str(runs.coherence()).splitlines()) == 4 and "0.29 - 23.2" in str(runs.coherence())


def test_results_show_their_own_numbers(result: Any, runs: Any) -> None:
    model = result.models["roll-yaw"]
    assert f"{model.fit['Izz'].value:.4g}" in str(model) and f"{model.fit['Izz'].value:.4g}" in str(model.fit)
    assert "good" in str(model) and f"TIC {model.verification[0].tic:.3f}" in str(model)
    assert f"{model.verification[0].j_rms:.3g}" in str(model.verification[0])
    response = result.groups[0].responses["r"]
    assert f"{response.band[1]:.3g} rad/s" in str(response)
    assert str(result.coherence).splitlines()[0] == str(runs.coherence()).splitlines()[0]
    assert result.summary[0] in str(result) and "bicycle" in str(result)
    assert all(len(str(x).splitlines()) < 30 for x in (result, model, response, model.verification[0]))


def test_a_notebook_gets_html_without_markup_of_the_data(result: Any, runs: Any) -> None:
    from dataclasses import replace

    html = result.models["roll-yaw"]._repr_html_()
    assert "<td>Izz</td>" in html and "&lt;= 50" in html
    evil = replace(runs[0], name="<script>")
    assert "<script>" not in (runs[:0] + [evil])._repr_html_()


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: rs.read(), "nothing to read"),
        (lambda: rs.read("nowhere.BIN"), "there is no such file"),
        (lambda: rs.identify(rs.read(NOMINAL / "run1.BIN")), "vehicle is not known"),
        (lambda: rs.load_result("nowhere.json"), "cannot be read"),
        (lambda: rs.load_result(ROVER), "is not JSON"),
    ],
)
def test_bad_input_is_one_sentence(call: Any, words: str) -> None:
    with pytest.raises(rs.UsageError, match=words) as caught:
        call()
    assert "\n" not in str(caught.value)


def test_unknown_names_and_own_judges_are_refused(runs: Any) -> None:
    with pytest.raises(rs.UsageError, match="no parameter 'Ixy'"):
        rs.identify(runs, keep=["Ixy"])
    with pytest.raises(rs.UsageError, match="no fixed parameter of the roll-yaw model 'Y_phi'"):
        rs.identify(runs, free=["Y_phi"])
    with pytest.raises(rs.UsageError, match="no model 'tricycle'"):
        rs.identify(runs, models=["tricycle"])
    with pytest.raises(rs.UsageError, match="used both to identify and to verify"):
        rs.identify(runs, verify=runs[:1])


def same(a: Any, b: Any, where: str = "result") -> None:
    """Everything equal, arrays to the last bit."""
    if is_dataclass(a):
        assert type(a) is type(b), where
        for f in fields(a):
            same(getattr(a, f.name), getattr(b, f.name), f"{where}.{f.name}")
    elif isinstance(a, np.ndarray):
        assert a.dtype == b.dtype, where
        np.testing.assert_array_equal(a, b, where)
    elif isinstance(a, dict):
        assert list(a) == list(b), where
        for key in a:
            same(a[key], b[key], f"{where}[{key!r}]")
    elif isinstance(a, tuple | list):
        assert len(a) == len(b), where
        for k, (x, y) in enumerate(zip(a, b, strict=True)):
            same(x, y, f"{where}[{k}]")
    else:
        assert a == b or (a != a and b != b), where


def test_saving_and_loading_loses_nothing(result: Any, tmp_path: Path) -> None:
    path = result.save(tmp_path / "result.json")
    again = rs.load_result(path)
    same(result, again)
    assert path.stat().st_size < 5e6
    assert again.save(tmp_path / "again.json").read_bytes() == path.read_bytes()
    w = np.geomspace(0.3, 25, 5)
    models = [r.models["roll-yaw"].fit.structure for r in (result, again)]
    responses = [m.response(w, 2.0, "ay") for m in models]
    np.testing.assert_array_equal(*responses)


def test_a_users_own_structure_is_saved_as_its_text() -> None:
    from rover_sweep.api.save import dumps, loads
    from rover_sweep.identification.toml_form import structure_from_text

    text = sorted((ROOT / "tests/data/structures").glob("*.toml"))[0].read_text()
    structure = structure_from_text(text)
    name = structure.free[0].name
    moved = structure.with_values({name: 1.1 * structure.values[name]})
    w = np.geomspace(0.3, 25, 5)
    responses = [m.response(w, 2.0, structure.outputs[0]) for m in (moved, loads(dumps(moved)))]
    np.testing.assert_array_equal(*responses)


def test_another_version_of_the_file_is_told(result: Any, tmp_path: Path) -> None:
    path = result.save(tmp_path / "result.json")
    document = json.loads(path.read_text())
    path.write_text(json.dumps(document | {"format_version": 99}))
    with pytest.raises(rs.UsageError, match="has version 99"):
        rs.load_result(path)
    document["result"]["of"]["settings"]["of"]["later_option"] = True
    path.write_text(json.dumps(document))
    with pytest.raises(rs.UsageError, match="later_option"):
        rs.load_result(path)


def test_a_file_cannot_call_what_it_likes(tmp_path: Path) -> None:
    path = tmp_path / "evil.json"
    for evil in ("os:system", "rover_sweep.cli.main:run", "loads", "Path"):
        for thing in ({"is": evil, "of": {}}, {"is": "function", "of": evil}):
            content = {"format": "rover-sweep result", "format_version": 2, "result": thing, "arrays": {}}
            path.write_text(json.dumps(content))
            with pytest.raises(rs.UsageError, match="identify again"):
                rs.load_result(path)
