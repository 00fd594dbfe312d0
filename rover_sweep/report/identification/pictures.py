"""The report's pictures, their captions, and the functions that draw them."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial

from matplotlib.figure import Figure

from rover_sweep.data.recording import Recording
from rover_sweep.identification.acceptance import identified_runs, usable
from rover_sweep.identification.grouping import Group
from rover_sweep.identification.pipeline import Identification, ModelResult
from rover_sweep.report.pictures.frequency_response import measured_responses, modelled_responses
from rover_sweep.report.pictures.history import history
from rover_sweep.report.pictures.style import png, styled
from rover_sweep.report.pictures.verification import verification
from rover_sweep.report.wording.provenance import Provenance

HISTORY = (
    "White: the manoeuvre, used for the spectra. Blue marks at the bottom: standstill and straight driving, "
    "used to estimate biases."
)
MODELS = (
    "with the sensors' known filters. The fit uses the range between the orange lines, of the responses "
    "named as fitted."
)
RESPONSES = "Orange lines: the usable band (coherence at least 0.6, brief drops allowed)."


@dataclass(frozen=True, eq=False)
class Picture:
    """A picture of a report. name: of its file, without .png; section: of its page; make: its figure."""

    name: str
    section: str
    caption: str
    make: Callable[[], Figure]

    def figure(self) -> Figure:
        """The figure, in the report's style."""
        with styled():
            return self.make()

    def png(self) -> bytes:
        """The figure as PNG bytes."""
        with styled():
            return png(self.make())


def planned(result: Identification, provenance: Provenance) -> tuple[Picture, ...]:
    """All pictures of a result, not drawn yet; every name is different."""
    pictures = [
        *_verifications(result, provenance),
        *_responses(result),
        *_histories((*identified_runs(result), *provenance.verify_runs)),
    ]
    return tuple(_distinct(pictures))


def shown_models(result: Identification) -> dict[str, ModelResult]:
    """The models to draw: all valid ones, the kinematic one only if recommended or alone."""
    found = usable(result)
    larger = {n: m for n, m in found.items() if n != "kinematic"}
    return found if result.recommended == "kinematic" or not larger else larger


def _histories(runs: tuple[Recording, ...]) -> Iterator[Picture]:
    for run in runs:
        caption = f"Time history of {run.name}. {HISTORY}"
        yield Picture(f"history-{_slug(run.name)}", "recordings", caption, partial(history, run))


def _responses(result: Identification) -> Iterator[Picture]:
    models = shown_models(result)
    for group in (g for g in result.groups if g.responses):
        at = f" at {group.speed:.2f} m/s"
        suffix = f"-{group.speed:.2f}mps".replace(".", "p") if len(result.groups) > 1 else ""
        if models:
            caption = f"Measured responses{at} and the models' {MODELS}"
            if "lumped" in models and group is not result.groups[0]:
                caption += f" The lumped model is valid only at {result.speed:.2f} m/s."
            yield Picture(f"models{suffix}", "models", caption, partial(modelled_responses, group, models))
        caption = f"Measured frequency responses{at}, composite of windows of {_windows(group)}. {RESPONSES}"
        yield Picture(f"responses{suffix}", "responses", caption, partial(measured_responses, group))


def _windows(group: Group) -> str:
    lengths = next(iter(group.responses.values())).windows
    return ", ".join(f"{t:.1f}" for t in lengths) + " s"


def _verifications(result: Identification, provenance: Provenance) -> Iterator[Picture]:
    models = shown_models(result)
    count = max((len(m.verification) for m in models.values()), default=0)
    for k in range(count):
        verdicts = {n: m.verification[k] for n, m in models.items() if k < len(m.verification)}
        name = next(iter(verdicts.values())).run
        run = provenance.verify_runs[k] if k < len(provenance.verify_runs) else None
        caption = (
            f"Verification on {name}, which is not in the fit: its measured steering is the models' input."
        )
        draw = partial(verification, run, verdicts)
        yield Picture(f"verification-{_slug(name)}", "verification", caption, draw)


def _slug(text: str) -> str:
    return re.sub(r"[^A-Za-z0-9]+", "-", text).strip("-").lower() or "run"


def _distinct(pictures: list[Picture]) -> Iterator[Picture]:
    seen: dict[str, int] = {}
    for picture in pictures:
        seen[picture.name] = seen.get(picture.name, 0) + 1
        again = seen[picture.name]
        yield picture if again == 1 else replace(picture, name=f"{picture.name}-{again}")
