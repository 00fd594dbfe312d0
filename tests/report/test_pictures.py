"""The pictures show the data, the models with the known filters, units, and nothing else."""

from __future__ import annotations

import io
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.image import imread

from rover_sweep.report.identification.page import planned, shown_models
from rover_sweep.report.pictures.frequency_response import (
    history,
    measured_responses,
    modelled_responses,
    verification,
)
from rover_sweep.report.pictures.picture import MODEL_LINES, Picture


def figures_of(case: Any) -> dict[str, Picture]:
    """The pictures of the paper's figures, as the study draws them."""
    group, models = case.result.groups[0], shown_models(case.result)
    verdicts = {n: m.verification[0] for n, m in models.items() if m.verification}
    run = case.provenance.verify_runs[0]
    made = {
        "models": partial(modelled_responses, group, models),
        "responses": partial(measured_responses, group),
        "verification": partial(verification, run, verdicts),
    }
    return {name: Picture(name, "", "", make) for name, make in made.items()}


@pytest.fixture(scope="module")
def pictures(nominal: Any) -> dict[str, Picture]:
    return figures_of(nominal)


def line(axes: Axes, label: str) -> np.ndarray:
    """(n, 2) x and y of the line of that label."""
    found = next(item for item in axes.get_lines() if item.get_label() == label)
    return np.column_stack((np.asarray(found.get_xdata()), np.asarray(found.get_ydata())))


def panel(figure: Figure, words: str) -> Axes:
    """The panel whose title or label has the words."""
    return next(a for a in figure.axes if words in a.get_title(loc="left") + a.get_ylabel())


def test_there_is_one_for_each_run_the_models_their_errors_and_the_verification(nominal: Any) -> None:
    names = [p.name for p in planned(nominal.result, nominal.provenance)]
    assert names == ["models", "errors", "verification-run4", "history-run1", "history-run2", "history-run4"]


def test_model_lines_are_the_models_with_the_sensors_filters(
    pictures: dict[str, Picture], nominal: Any
) -> None:
    figure = pictures["models"].figure()
    group = nominal.result.groups[0]
    w = group.responses["r"].w
    for name in ("bicycle", "roll-yaw", "lumped"):
        structure = nominal.result.models[name].fit.structure
        h = structure.response(w, group.speed, "r", group.runs[0].filters)
        shown = line(panel(figure, "yaw rate r / steering"), f"{name} model")
        np.testing.assert_allclose(shown[:, 1], 20 * np.log10(np.abs(h)))
    measured = line(panel(figure, "yaw rate r / steering"), "measured")
    np.testing.assert_allclose(measured[:, 1], group.responses["r"].magnitude_db)
    assert "bicycle model" not in [item.get_label() for item in panel(figure, "roll rate p").get_lines()]


def test_phase_of_the_models_lies_beside_that_of_the_data(pictures: dict[str, Picture]) -> None:
    for axes in pictures["models"].figure().axes:
        if axes.get_ylabel() == "phase, deg":
            drawn = [np.asarray(item.get_ydata()) for item in axes.get_lines()]
            measured, *models = [y for y in drawn if y.size > 10]
            assert models and all(abs(np.median(y - measured)) < 60 for y in models)


def test_frequency_axes_are_logarithmic_in_rad_per_s_and_mark_the_usable_band(
    pictures: dict[str, Picture], nominal: Any
) -> None:
    figure = pictures["responses"].figure()
    assert len(figure.axes) == 12
    assert all(a.get_xscale() == "log" for a in figure.axes)
    assert sum(a.get_xlabel() == "frequency, rad/s" for a in figure.axes) == 4
    lines = panel(figure, "lateral velocity rate").get_lines()[1:]
    edges = [float(np.asarray(item.get_xdata())[0]) for item in lines]
    assert edges == pytest.approx(nominal.result.groups[0].responses["vydot"].band)


def test_verification_shows_the_overlays_with_j_rms_and_tic(
    pictures: dict[str, Picture], nominal: Any
) -> None:
    figure = pictures["verification"].figure()
    verdict = nominal.result.models["roll-yaw"].verification[0]
    label = f"roll-yaw: $J_{{rms}}$ {verdict.j_rms:.2f}, TIC {verdict.tic:.3f}"
    for overlay, words in zip(
        verdict.overlays, ("yaw rate r\ndeg/s", "ft/s²", "roll rate p\ndeg/s"), strict=True
    ):
        np.testing.assert_array_equal(line(panel(figure, words), label)[:, 1], overlay.model)
        np.testing.assert_array_equal(line(panel(figure, words), "measured")[:, 1], overlay.measured)


def test_time_history_is_in_degrees_and_begins_with_the_manoeuvre(nominal: Any) -> None:
    run = nominal.result.groups[0].runs[0]
    figure = history(run)
    assert [a.get_ylabel().split("\n")[-1] for a in figure.axes] == [
        "PWM, µs",
        "deg/s",
        "m/s²",
        "deg/s",
        "m/s",
    ]
    shown = figure.axes[1].get_lines()[0]
    inside = (np.asarray(shown.get_xdata()) >= 0) & (
        np.asarray(shown.get_xdata()) <= run.span[1] - run.span[0]
    )
    np.testing.assert_allclose(np.asarray(shown.get_ydata())[inside], np.degrees(run.manoeuvre("r").x))


def test_models_differ_in_colour_and_in_line_style() -> None:
    assert len({s["color"] for s in MODEL_LINES.values()}) == len(MODEL_LINES)
    assert len({str(s["linestyle"]) for s in MODEL_LINES.values()}) == len(MODEL_LINES)


def test_a_rejected_model_is_not_drawn(stock: Any) -> None:
    pictures = figures_of(stock)
    labels = {item.get_label() for a in pictures["models"].figure().axes for item in a.get_lines()}
    assert "kinematic model" in labels and "bicycle model" not in labels


def test_a_response_without_a_band_is_drawn_with_its_phase_within_half_a_turn(stock: Any) -> None:
    pictures = figures_of(stock)
    figure = pictures["responses"].figure()
    k = figure.axes.index(panel(figure, "roll rate p"))
    assert "no usable band" in figure.axes[k].get_title(loc="left")
    assert np.max(np.abs(figure.axes[k + 1].get_lines()[0].get_ydata())) <= 180


def test_runs_of_the_same_name_get_pictures_of_different_names(nominal: Any) -> None:
    again = replace(nominal.provenance, verify_runs=nominal.result.groups[0].runs)
    names = [p.name for p in planned(nominal.result, again)]
    assert len(set(names)) == len(names) and "history-run1-2" in names


def test_a_picture_is_a_png_as_wide_as_the_page_and_the_same_each_time(pictures: dict[str, Picture]) -> None:
    data = pictures["verification"].png()
    assert imread(io.BytesIO(data)).shape[1] > 1100
    assert data == pictures["verification"].png()
