"""The Python API as a user meets it: README's lines, tables, bad input, saving and loading."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pytest
from matplotlib import pyplot

import rover_sweep as rs
from rover_sweep.api.read import Runs
from rover_sweep.api.simulate import diagnosis_file

ROOT = Path(__file__).parents[2]
NOMINAL = ROOT / "tests/data/ardurover-4.6.3/nominal"
ROVER = ROOT / "tests/data/rover.toml"


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda runs, _: rs.identify(runs, verify="run4"), "verify: 'run4' is no run"),
        (lambda runs, _: rs.identify(runs, verify=runs[:1]), "used both to identify and to verify"),
        (lambda runs, _: rs.identify(runs, bands={"q": (1, 2)}), "there is no response 'q'"),
        (lambda runs, _: rs.identify(runs, bands="r"), "bands is 'r'"),
        (lambda runs, _: rs.identify(runs, bands={"r": 3}), r"the band of r is 3; give \(lowest, highest\)"),
        (lambda runs, _: rs.identify(runs, band="x"), "band is 'x'"),
        (lambda runs, _: rs.identify(runs, models=3), "there is no model 3"),
        (lambda runs, _: rs.identify(runs, models=["tricycle"]), "no model 'tricycle'"),
        (lambda runs, _: rs.identify(runs, keep=["Ixy"]), "no parameter 'Ixy'"),
        (
            lambda runs, _: rs.identify(runs, free=["Y_phi"]),
            "no fixed parameter of the roll-yaw model 'Y_phi'",
        ),
        (lambda *_: rs.identify(rs.read(NOMINAL / "run1.BIN")), "vehicle is not known"),
        (lambda *_: rs.read(), "nothing to read"),
        (lambda *_: rs.read("nowhere.BIN"), "there is no such file"),
        (lambda *_: rs.read(3), "takes paths of files or folders, not 3"),
        (lambda *_: rs.read(NOMINAL / "run1.BIN", vehicle=3), "vehicle is 3; give the path"),
        (lambda *_: rs.load_result("nowhere.json"), "cannot be read"),
        (lambda *_: rs.load_result(ROVER), "is not JSON"),
        (lambda runs, _: runs["run1"].plot([]), "no channel is named; choose from pwm"),
        (lambda runs, _: runs.plot("yaw"), "run1 has no channel 'yaw'; it has pwm"),
        (lambda runs, _: runs[:0].plot(), "there is no run to draw"),
        (lambda runs, _: runs[0].to_frame(rate=0), "the rate is 0"),
        (lambda runs, _: runs[:0].to_frame(), "no run to put into a frame"),
        (lambda _, result: result.plot(["x"]), "the result has no response 'x'; it has r"),
        (lambda _, result: result.plot(models=["tricycle"]), "no model 'tricycle'"),
        (lambda _, result: result.plot(group=3), "there is no group 3"),
        (lambda _, result: result.responses["r"].plot(axes="r"), "axes holds a str"),
        (lambda _, result: replace(result.models["roll-yaw"], verification=()).plot(), "verified on no run"),
        (
            lambda runs, result: rs.simulate(result.models["roll-yaw"], runs["run4"]).error("vy"),
            "run4 has no channel 'vy' to compare; it has r, ay, p",
        ),
    ],
)
def test_a_wrong_argument_is_one_sentence(runs: Any, result: Any, call: Any, words: str) -> None:
    with pytest.raises(rs.UsageError, match=words) as caught:
        call(runs, result)
    assert "\n" not in str(caught.value)


def test_runs_are_a_sequence_with_names(runs: Any) -> None:
    assert [r.kind for r in runs] == ["sweep", "doublet"] and "2 runs of example rover" in repr(runs)
    assert [r.name for r in runs[:1] + runs[1:]] == ["run1", "run4"]
    assert runs["run4"] is runs[1] and "run4" in runs and runs[1] in runs and "run2" not in runs
    with pytest.raises(KeyError, match="there is no run 'run2'; the names are run1, run4"):
        runs["run2"]


def test_the_lines_of_the_readme_run_as_they_stand(
    result: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The example of the package identifies; here the other lines matter."""
    (block,) = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    assert len([line for line in block.splitlines() if line]) <= 10
    for name in re.findall(r'"(run\d\.BIN)"', block):
        (tmp_path / name).symlink_to(NOMINAL / name)
    (tmp_path / "rover.toml").symlink_to(ROVER)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(rs, "identify", lambda runs: result)
    exec(block, {})
    shown = capsys.readouterr().out
    assert "yaw inertia about the CG" in shown and "90 % interval" in shown
    assert (tmp_path / "report" / "report.html").stat().st_size > 100_000
    assert json.loads((tmp_path / "report" / "identification.json").read_text())["recommended"] == "roll-yaw"


def test_importing_loads_nothing_slow() -> None:
    slow = ("numpy", "scipy", "matplotlib", "pymavlink")
    script = f"import sys, rover_sweep; print([m for m in {slow} if m in sys.modules])"
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "[]"
    with pytest.raises(AttributeError, match="no_such"):
        rs.no_such  # noqa: B018


def test_results_show_their_own_numbers(result: Any) -> None:
    model = result.models["roll-yaw"]
    assert f"{model.fit['Izz'].value:.4g}" in str(model) and f"{model.fit['Izz'].value:.4g}" in str(model.fit)
    assert "good" in str(model) and f"TIC {model.verification[0].tic:.3f}" in str(model)
    assert f"{model.verification[0].j_rms:.3g}" in str(model.verification[0])
    response = result.groups[0].responses["r"]
    assert f"{response.band[1]:.3g} rad/s" in str(response)
    table = result.coherence
    assert "keep: coherence" in repr(table[0])
    assert len(str(table).splitlines()) == 3 and "0.29 - 23.2" in str(table)
    assert result.summary[0] in str(result) and "bicycle" in str(result)
    assert all(len(str(x).splitlines()) < 30 for x in (result, model, response, model.verification[0]))


def test_a_notebook_gets_html_without_markup_of_the_data(result: Any, runs: Any) -> None:
    html = result.models["roll-yaw"]._repr_html_()
    assert "<td>Izz</td>" in html and "&lt;= 50" in html
    evil = replace(runs[0], name="<script>")
    assert "<script>" not in (runs[:0] + [evil])._repr_html_()


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


# ---- Results for scientists: matplotlib axes in and out, data frames, plain numbers, names as in JSON.

matplotlib.use("Agg")


@pytest.fixture(autouse=True)
def closed() -> Iterator[None]:
    yield
    pyplot.close("all")


def numpy_scalars(value: Any, where: str = "") -> Iterator[str]:
    """Where in a result numpy's scalars are; structures of models are not results."""
    if isinstance(value, np.generic):
        yield f"{where}: {value!r}"
    elif is_dataclass(value) and not isinstance(value, type):
        for f in fields(value):
            if f.name not in ("structure", "model"):
                yield from numpy_scalars(getattr(value, f.name), f"{where}.{f.name}")
    elif isinstance(value, dict):
        for key, one in value.items():
            yield from numpy_scalars(one, f"{where}[{key!r}]")
    elif isinstance(value, tuple | list):
        for k, one in enumerate(value):
            yield from numpy_scalars(one, f"{where}[{k}]")


def test_floats_print_as_floats(runs: Runs, result: rs.Result, found: rs.FullDiagnosis) -> None:
    for thing in (runs, runs.coherence(), result, result.handling, found, found.model.x):  # type: ignore[union-attr]
        assert list(numpy_scalars(thing)) == []
    assert "np.float64" not in repr(result.models["roll-yaw"].fit.estimates) + repr(found.findings)


def test_a_saved_diagnosis_keeps_its_names(found: rs.FullDiagnosis, tmp_path: Path) -> None:
    saved = found.save(tmp_path / "found.json")
    assert diagnosis_file(saved) == saved, "export and simulate take it too"
    again = rs.load_diagnosis(saved)
    assert again.findings[0].parameters["b"] == found.findings[0].parameters["b"]
    assert again.parameters == found.parameters
    assert again.plot("run4").shape == found.plot("run4").shape


def lines(axes: Any) -> list[np.ndarray]:
    return [line.get_ydata() for line in axes.lines]


def test_axes_go_in_and_come_out(runs: Runs, result: rs.Result, found: rs.FullDiagnosis) -> None:
    simulated = rs.simulate(result.models["roll-yaw"], runs["run4"])
    calls: list[tuple[Any, int]] = [
        (lambda axes: runs.plot(["pwm", "r"], axes=axes), 4),
        (lambda axes: runs[0].plot(axes=axes), 5),
        (lambda axes: runs[0].plot("r", axes=axes), 1),
        (lambda axes: result.responses["ay"].plot(axes=axes), 3),
        (lambda axes: result.plot(["r", "ay"], axes=axes), 6),
        (lambda axes: result.models["roll-yaw"].plot(axes=axes), 3),
        (lambda axes: result.models["roll-yaw"].verification[0].plot(axes=axes), 3),
        (lambda axes: simulated.plot(["r", "ay"], axes=axes), 2),
        (lambda axes: found.plot(axes=axes), 2 * len({o.channel for o in found.overlays})),
    ]
    for call, count in calls:
        fresh = call(None)
        assert fresh.size == count and all(one.has_data() for one in fresh.flat)
        given = pyplot.figure().subplots(1, count, squeeze=False)
        back = call(given if count > 1 else given[0, 0])
        assert list(back.flat) == list(given.flat) and all(one.has_data() for one in given.flat)
        with pytest.raises(rs.UsageError, match=f"{count + 1} axes were given, but {count} are needed"):
            call(pyplot.figure().subplots(1, count + 1))
        pyplot.close("all")


def test_the_drawn_numbers_are_the_results(runs: Runs, result: rs.Result) -> None:
    measured = result.responses["r"].plot()[0]
    assert any(np.array_equal(y, result.responses["r"].magnitude_db) for y in lines(measured))
    yaw_rate = runs["run4"].plot(["r"])[0]
    inside = runs["run4"].manoeuvre("r")
    assert lines(yaw_rate)[0].max() == pytest.approx(np.degrees(inside.x.max()), rel=0.05)
    drawn = result.plot(["r"], models=["bicycle"])[0, 0].get_legend_handles_labels()[1]
    assert "bicycle model" in drawn and "roll-yaw model" not in drawn


def test_frames_hold_the_same_numbers(runs: Runs, result: rs.Result, found: rs.FullDiagnosis) -> None:
    frame = result.to_frame()
    tau = result.models["roll-yaw"].parameters["tau"]
    assert frame.loc["roll-yaw", "tau"]["value"] == tau.value
    assert tuple(frame.loc["roll-yaw", "tau"][["low", "high"]]) == tau.interval_90
    assert set(frame.index.get_level_values("model")) == set(result.models)
    response = result.responses["ay"]
    usable = response.to_frame().query("usable")
    assert response.band == (usable.index[0], usable.index[-1])
    t, columns = runs["run1"].uniform(50.0)
    sampled = runs.to_frame(rate=50).loc["run1"]
    np.testing.assert_array_equal(sampled.index, t)
    np.testing.assert_array_equal(sampled["r"], columns["r"])
    verdicts = runs.coherence().to_frame()
    assert list(verdicts["run"].unique()) == ["run1", "run4"] and verdicts["keep"].all()
    row = found.to_frame().loc["steering_backlash", "b"]
    assert row["value"] == found.findings[0].parameters["b"].value and 0.5 < row["removed"] < 1.5
    simulated = rs.simulate(found, runs["run4"])
    error = simulated.to_frame().eval("r_measured - r")
    assert float(np.sqrt((error**2).mean())) == pytest.approx(simulated.error("r"))


def test_without_pandas_one_sentence_says_what_to_install(
    runs: Runs, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    for call in (runs.to_frame, runs[0].to_frame, runs.coherence().to_frame):
        with pytest.raises(rs.UsageError, match=r"pip install -e '\.\[pandas\]'"):
            call()


def test_models_of_two_results_are_drawn_over_the_measured_response(result):
    model = result.models["roll-yaw"]
    axes = rs.bode(model, result.models["bicycle"], model, result, outputs=["r"])
    lines = [line.get_label() for line in axes[0, 0].get_lines()]
    assert axes.shape == (3, 1)
    names = ("roll-yaw model", "bicycle model", "roll-yaw (2) model")
    assert set(names) <= set(lines)
    with pytest.raises(rs.UsageError, match="one result"):
        rs.bode(model)


def test_a_model_shows_its_matrices_and_parameters(result):
    model = result.models["roll-yaw"]
    assert model["Izz"] is model.parameters["Izz"]
    with pytest.raises(KeyError, match="the names are"):
        model["mass_of_the_moon"]
    w, v = 3.0, model.fit.speed
    h = model.C @ np.linalg.solve(1j * w * np.eye(len(model.A)) - model.A, model.B) + model.D
    late = np.exp(-1j * w * model["tau"].value)
    k = model.fit.structure.outputs.index("ay")
    np.testing.assert_allclose(h[k, 0] * late, model.fit.structure.response(np.array([w]), v, "ay")[0])
    assert model.to_control(pade=0).nstates == len(model.A)
