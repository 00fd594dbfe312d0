"""The report's pictures: which there are, what they say, and how each is drawn."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from rover_sweep.identify.identification import Group, Identification, ModelResult
from rover_sweep.identify.recording import Recording
from rover_sweep.report.provenance import Provenance
from rover_sweep.report.standing import identified_runs, usable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Section = Literal["recordings", "responses", "models", "verification"]


@dataclass(frozen=True, eq=False)
class Picture:
    """A picture of the report. name: of its file, without .png; draw: makes the figure."""

    name: str
    section: Section
    caption: str
    draw: Callable[[], Figure]

    def png(self) -> bytes:
        """The picture drawn."""
        from rover_sweep.report.picture_style import png, styled

        with styled():
            return png(self.draw())


def planned(result: Identification, provenance: Provenance) -> tuple[Picture, ...]:
    """All pictures of a result, none of them drawn yet; every name is different."""
    pictures = [
        *_verifications(result, provenance),
        *_responses(result),
        *_histories((*identified_runs(result), *provenance.verify_runs)),
    ]
    return tuple(_distinct(pictures))


def shown_models(result: Identification) -> dict[str, ModelResult]:
    """The models to draw: those with findings; the kinematic one where it is the answer or the only one."""
    found = usable(result)
    rich = {n: m for n, m in found.items() if n != "kinematic"}
    return found if result.recommended == "kinematic" or not rich else rich


def _histories(runs: tuple[Recording, ...]) -> Iterator[Picture]:
    for run in runs:
        yield Picture(
            f"history-{_slug(run.name)}",
            "recordings",
            f"Time history of {run.name}. White: the manoeuvre, which the spectra use; "
            "blue marks at the bottom: standstill and straight driving, from which biases are taken.",
            lambda run=run: _history(run),  # type: ignore[misc]
        )


def _history(run: Recording) -> Figure:
    from rover_sweep.report.history_picture import history

    return history(run)


def _responses(result: Identification) -> Iterator[Picture]:
    models = shown_models(result)
    for group in result.groups:
        if not group.responses:
            continue
        at = f" at {group.speed:.2f} m/s"
        suffix = f"-{group.speed:.2f}mps".replace(".", "p") if len(result.groups) > 1 else ""
        if models:
            yield Picture(
                f"models{suffix}",
                "models",
                f"Measured responses{at} and the models' with the sensors' known filters. The fit sees what lies "
                "between the orange lines, of the responses named as fitted.",
                lambda group=group: _modelled(group, models),  # type: ignore[misc]
            )
        yield Picture(
            f"responses{suffix}",
            "responses",
            f"Measured frequency responses{at}, composite of windows of {_windows(group)}. Orange lines: the usable "
            "band (coherence at least 0.6, brief drops allowed).",
            lambda group=group: _measured(group),  # type: ignore[misc]
        )


def _windows(group: Group) -> str:
    lengths = next(iter(group.responses.values())).windows
    return ", ".join(f"{t:.1f}" for t in lengths) + " s"


def _modelled(group: Group, models: dict[str, ModelResult]) -> Figure:
    from rover_sweep.report.response_picture import modelled_responses

    return modelled_responses(group, models)


def _measured(group: Group) -> Figure:
    from rover_sweep.report.response_picture import measured_responses

    return measured_responses(group)


def _verifications(result: Identification, provenance: Provenance) -> Iterator[Picture]:
    models = shown_models(result)
    count = max((len(m.verification) for m in models.values()), default=0)
    for k in range(count):
        verdicts = {n: m.verification[k] for n, m in models.items() if k < len(m.verification)}
        name = next(iter(verdicts.values())).run
        run = provenance.verify_runs[k] if k < len(provenance.verify_runs) else None
        yield Picture(
            f"verification-{_slug(name)}",
            "verification",
            f"Verification on {name}, which no fit has seen: the models are driven by its measured steering.",
            lambda run=run, verdicts=verdicts: _verification(run, verdicts),  # type: ignore[misc]
        )


def _verification(run, verdicts) -> Figure:  # type: ignore[no-untyped-def]
    from rover_sweep.report.verification_picture import verification

    return verification(run, verdicts)


def _slug(text: str) -> str:
    return re.sub(r"[^A-Za-z0-9]+", "-", text).strip("-").lower() or "run"


def _distinct(pictures: list[Picture]) -> Iterator[Picture]:
    from dataclasses import replace

    seen: dict[str, int] = {}
    for picture in pictures:
        seen[picture.name] = seen.get(picture.name, 0) + 1
        again = seen[picture.name]
        yield picture if again == 1 else replace(picture, name=f"{picture.name}-{again}")
