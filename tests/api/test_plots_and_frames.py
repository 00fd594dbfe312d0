"""Results for scientists: matplotlib axes in and out, data frames, plain numbers, names as in JSON."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pytest

import rover_sweep as rs
from rover_sweep.api.read import Runs
from rover_sweep.api.simulate import diagnosis_file
from rover_sweep.report.diagnosis.diagnosis_json import diagnosis_document
from rover_sweep.report.identification.identification_json import identification_document

matplotlib.use("Agg")
from matplotlib import pyplot

DATA = Path(__file__).parents[1] / "data"
WORN = DATA / "concealed-ardurover" / "f"


@pytest.fixture(scope="module")
def found() -> rs.FullDiagnosis:
    worn = rs.read(WORN / "run2.BIN", WORN / "run4.BIN", vehicle=WORN / "rover.toml")
    return rs.diagnose(worn, only=["steering_backlash"])


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


def test_what_a_prompt_shows_is_a_table(runs: Runs, result: rs.Result, found: rs.FullDiagnosis) -> None:
    parameters = repr(result.models["roll-yaw"].parameters).splitlines()
    assert [line.split()[0] for line in parameters[1:4]] == ["parameter", "C", "Izz"]
    assert " to " in parameters[2] and parameters[2].endswith("cornering stiffness, each axle")
    assert "rad/s from IMU.GyrZ" in repr(runs["run1"]["r"]) and "array" not in repr(runs["run1"]["r"])
    finding = found.findings[0]
    assert repr(finding).startswith(finding.effect) and finding.sentence in repr(finding)
    assert "identify" in dir(rs) and "TYPE_CHECKING" not in dir(rs)


def test_parameters_have_the_names_of_the_json(result: rs.Result, found: rs.FullDiagnosis) -> None:
    document = identification_document(result, result.origin)["models"]["roll-yaw"]["parameters"]
    own = result.models["roll-yaw"].parameters
    assert list(document) == list(own.keys())
    for name, entry in document.items():
        interval = own[name].interval_90
        assert entry["interval_90"] == (None if interval is None else list(interval))
        for key in ("value", "unit", "free", "cr_percent", "insensitivity_percent", "sd", "bias", "meaning"):
            assert entry[key] == getattr(own[name], key), (name, key)
    written = diagnosis_document(found, found.origin)
    assert written["findings"][0]["parameters"]["b"]["value"] == found.findings[0].parameters["b"].value
    assert {n: v["low"] for n, v in written["parameters"].items()} == {
        n: v.low for n, v in found.parameters.items()
    }
    with pytest.raises(KeyError, match="there is no 'bb'; the names are b"):
        found.findings[0].parameters["bb"]


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


def test_a_notebooks_backend_starts_outside_the_style(runs: Runs, monkeypatch: pytest.MonkeyPatch) -> None:
    """The inline backend switches to interactive at the first figure; the style's context would undo that."""
    make, grids = pyplot.figure, []

    def figure(*args: Any, **options: Any) -> Any:
        grids.append(matplotlib.rcParams["axes.grid"])
        return make(*args, **options)

    monkeypatch.setattr(pyplot, "figure", figure)
    runs[0].plot("r")
    assert grids == [False]


def test_the_drawn_numbers_are_the_results(runs: Runs, result: rs.Result) -> None:
    measured = result.responses["r"].plot()[0]
    assert any(np.array_equal(y, result.responses["r"].magnitude_db) for y in lines(measured))
    yaw_rate = runs["run4"].plot(["r"])[0]
    inside = runs["run4"].manoeuvre("r")
    assert lines(yaw_rate)[0].max() == pytest.approx(np.degrees(inside.x.max()), rel=0.05)
    drawn = result.plot(["r"], models=["bicycle"])[0, 0].get_legend_handles_labels()[1]
    assert "bicycle model" in drawn and "roll-yaw model" not in drawn


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda runs, result: runs.plot("yaw"), "run1 has no channel 'yaw'; it has pwm"),
        (lambda runs, result: runs[:0].plot(), "there is no run to draw"),
        (lambda runs, result: result.plot(["x"]), "the result has no response 'x'; it has r"),
        (lambda runs, result: result.plot(models=["tricycle"]), "no model 'tricycle'"),
        (lambda runs, result: result.plot(group=3), "there is no group 3"),
        (lambda runs, result: result.responses["r"].plot(axes="r"), "axes holds a str"),
        (
            lambda runs, result: rs.simulate(result.models["roll-yaw"], runs["run4"]).error("vy"),
            "run4 has no channel 'vy' to compare; it has r, ay, p",
        ),
        (lambda runs, result: runs[0].to_frame(rate=0), "the rate is 0"),
        (lambda runs, result: runs[:0].to_frame(), "no run to put into a frame"),
    ],
)
def test_wrong_arguments_are_one_sentence(runs: Runs, result: rs.Result, call: Any, words: str) -> None:
    with pytest.raises(rs.UsageError, match=words) as caught:
        call(runs, result)
    assert "\n" not in str(caught.value)


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


def test_runs_are_found_by_name(runs: Runs) -> None:
    assert runs["run4"] is runs[1] and "run4" in runs and runs[1] in runs and "run2" not in runs
    with pytest.raises(KeyError, match="there is no run 'run2'; the names are run1, run4"):
        runs["run2"]


def test_a_model_without_verification_says_what_to_do(result: rs.Result) -> None:
    from dataclasses import replace

    bare = replace(result.models["roll-yaw"], verification=())
    with pytest.raises(rs.UsageError, match="verified on no run"):
        bare.plot()


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


def test_the_document_of_a_report_is_no_saved_result(result, tmp_path):
    files = result.report(tmp_path / "report")
    with pytest.raises(rs.UsageError, match="document of a report.*result.save"):
        rs.load_result(files.document)
