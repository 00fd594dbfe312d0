"""The report's charts, their captions, and the functions that make them."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from functools import partial

from rover_sweep.data.recording import Recording
from rover_sweep.identification.acceptance import identified_runs, usable
from rover_sweep.identification.grouping import Group
from rover_sweep.identification.pipeline import Identification, ModelResult
from rover_sweep.report.charts.chart import ChartPlan
from rover_sweep.report.charts.response_charts import error_chart, response_chart
from rover_sweep.report.charts.run_chart import run_chart
from rover_sweep.report.charts.verification_chart import verification_chart
from rover_sweep.report.wording.provenance import Provenance
from rover_sweep.report.wording.shown_units import SI, ShownUnits

HISTORY = (
    "White: the manoeuvre, used for the spectra. Light blue: standstill and straight driving, used to "
    "estimate biases."
)
MODELS = (
    "with the sensors' known filters. The fit uses the range between the orange lines, but no response "
    "whose title says that it is not in the fit."
)
ERRORS = (
    "Error of the models: |model / measured - 1| over frequency, in the usable band. Within the grey area "
    "(two standard deviations of the random error) the data cannot tell it from zero."
)
RESPONSES = "Orange lines: the usable band (coherence at least 0.6, brief drops allowed)."


def planned(result: Identification, provenance: Provenance, units: ShownUnits = SI) -> tuple[ChartPlan, ...]:
    """All charts of a result, not made yet; every name is different."""
    pictures = [
        *_responses(result, units),
        *_verifications(result, provenance, units),
        *_histories((*identified_runs(result), *provenance.verify_runs), units),
    ]
    return tuple(_distinct(pictures))


def shown_models(result: Identification) -> dict[str, ModelResult]:
    """The models to draw: all valid ones, the kinematic one only if recommended or alone."""
    found = usable(result)
    larger = {n: m for n, m in found.items() if n != "kinematic"}
    return found if result.recommended == "kinematic" or not larger else larger


def _histories(runs: tuple[Recording, ...], units: ShownUnits) -> Iterator[ChartPlan]:
    for run in runs:
        caption = f"Time history of {run.name}. {HISTORY}"
        yield ChartPlan(f"history-{_slug(run.name)}", "recordings", caption, partial(run_chart, run, units))


def _responses(result: Identification, units: ShownUnits) -> Iterator[ChartPlan]:
    models = shown_models(result)
    for group in (g for g in result.groups if g.responses):
        at = f" at {group.speed:.2f} m/s"
        suffix = f"-{group.speed:.2f}mps".replace(".", "p") if len(result.groups) > 1 else ""
        if models:
            caption = f"Measured responses{at} and the models' {MODELS}"
            if "lumped" in models and group is not result.groups[0]:
                caption += f" The lumped model is valid only at {result.speed:.2f} m/s."
            yield ChartPlan(
                f"models{suffix}", "models", caption, partial(response_chart, group, models, units)
            )
            if any(f.band for f in group.responses.values()):
                caption = f"{ERRORS[:20]}{at}{ERRORS[20:]}"
                yield ChartPlan(f"errors{suffix}", "errors", caption, partial(error_chart, group, models))
        else:
            caption = f"Measured frequency responses{at}, windows of {_windows(group)}. {RESPONSES}"
            yield ChartPlan(
                f"responses{suffix}", "models", caption, partial(response_chart, group, {}, units)
            )


def _windows(group: Group) -> str:
    lengths = next(iter(group.responses.values())).windows
    return ", ".join(f"{t:.1f}" for t in lengths) + " s"


def _verifications(result: Identification, provenance: Provenance, units: ShownUnits) -> Iterator[ChartPlan]:
    models = shown_models(result)
    count = max((len(m.verification) for m in models.values()), default=0)
    for k in range(count):
        verdicts = {n: m.verification[k] for n, m in models.items() if k < len(m.verification)}
        name = next(iter(verdicts.values())).run
        run = provenance.verify_runs[k] if k < len(provenance.verify_runs) else None
        caption = (
            f"Verification on {name}, which is not in the fit: its measured steering is the models' input."
        )
        draw = partial(verification_chart, run, verdicts, units)
        yield ChartPlan(f"verification-{_slug(name)}", "verification", caption, draw)


def _slug(text: str) -> str:
    return re.sub(r"[^A-Za-z0-9]+", "-", text).strip("-").lower() or "run"


def _distinct(pictures: list[ChartPlan]) -> Iterator[ChartPlan]:
    seen: dict[str, int] = {}
    for picture in pictures:
        seen[picture.name] = seen.get(picture.name, 0) + 1
        again = seen[picture.name]
        yield picture if again == 1 else replace(picture, name=f"{picture.name}-{again}")
