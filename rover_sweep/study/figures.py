"""Figures 2, 3, 6, 7 and 8 of the paper from the study's runs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

from rover_sweep.identification.pipeline import ModelResult
from rover_sweep.report.pictures.frequency_response import measured_responses, modelled_responses
from rover_sweep.report.pictures.history import history
from rover_sweep.report.pictures.picture import Picture
from rover_sweep.report.pictures.verification import verification
from rover_sweep.study.conditions import CHECKS
from rover_sweep.study.published import MODELS
from rover_sweep.study.virtual_study import Practice, Study

VERIFIED = {"asphalt": "figure-7", "grass": "figure-8a", "fast": "figure-8b"}


def figures(study: Study) -> Iterator[Picture]:
    """The figures in the paper's order, to be drawn later; the fits are those made as in the paper."""
    sweep = study.runs.sweeps[0]
    yield Picture(
        "figure-2", "recordings", "Figure 2: the sweep and the motion of the rover.", partial(history, sweep)
    )
    seen = replace(
        study.paper.group,
        responses={o: replace(f, band=study.coherent[o]) for o, f in study.paper.group.responses.items()},
    )
    yield Picture(
        "figure-3",
        "responses",
        f"Figure 3: identified frequency responses at {study.paper.group.speed:.2f} m/s on asphalt. "
        "Orange: where the coherence is at least 0.6.",
        partial(measured_responses, seen),
    )
    for practice, name in ((study.paper, "figure-6"), (study.known, "figure-6-filters-known")):
        caption = f"Figure 6: the models over the measured responses; {practice.words}."
        yield Picture(name, "models", caption, partial(modelled_responses, practice.group, _models(practice)))
    for check, name in VERIFIED.items():
        figure = "Figure 7" if check == "asphalt" else "Figure 8"
        caption = f"{figure}: {CHECKS[check]}, not used in any fit; {study.paper.words}."
        verdicts = {m: study.paper.check(m, check) for m in MODELS}
        draw = partial(verification, study.runs.checks[check], verdicts)
        yield Picture(name, "verification", caption, draw)


def _models(practice: Practice) -> dict[str, ModelResult]:
    return {m: practice.result.models[m] for m in MODELS}
