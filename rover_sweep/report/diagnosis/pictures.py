"""The pictures of a diagnosis and their captions."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

from rover_sweep.diagnosis.result import Diagnosis, Overlay
from rover_sweep.report.charts.overlay_chart import overlay_chart
from rover_sweep.report.pictures.law_curves import law_curves
from rover_sweep.report.pictures.mismatch import drawable, mismatch
from rover_sweep.report.pictures.overlay import overlay_figure
from rover_sweep.report.pictures.picture import Picture
from rover_sweep.report.pictures.scores import scores
from rover_sweep.report.wording.effect_names import sentence

OVERLAY = (
    "Time history with the residual (measured minus simulated), and the spectrum of the residual divided "
    "by the noise floor. Dashed or grey: twice the noise. In print, the shaded close-up is where {most}."
)
SCORES = (
    "Reduction of chi-squared by each candidate alone, compared with the model without effects. Effects "
    "overlap, so more candidates than the named ones exceed chance; the named ones are those that the whole "
    "search kept."
)

CURVES = (
    "The rover's laws at rest, with their 90 % bands, over the range that the runs visited. Dashed: the "
    "linear law, of a tyre its tangent at 0."
)
LAW = (
    "The laws that were fitted in the model for the part without a name, with their 90 % bands. A constant "
    "cannot be separated from trim and biases, so a curve is relative to its value at 0 or to its mean. Of a "
    "resonance the gain is drawn."
)


def planned(found: Diagnosis) -> tuple[Picture, ...]:
    """All pictures of a diagnosis, not drawn yet."""
    return (*_mismatches(found), *_runs(found), *_curves(found), *_law(found), *_scores(found))


def mismatch_section(index: int) -> str:
    """Section of the page for the picture of this mismatch."""
    return f"mismatch-{index}"


def _mismatches(found: Diagnosis) -> Iterator[Picture]:
    for k, m in enumerate(found.mismatch):
        if drawable(m, found.overlays):
            name = mismatch_section(k)
            yield Picture(name, name, sentence(m.sentence), partial(mismatch, m, found.overlays))


def _runs(found: Diagnosis) -> Iterator[Picture]:
    by_run: dict[tuple[str, bool], list[Overlay]] = {}
    for o in (o for o in found.overlays if o.t.size > 1):
        by_run.setdefault((o.run, o.held_out), []).append(o)
    changed = bool(found.findings)
    for k, ((run, held_out), channels) in enumerate(by_run.items()):
        role = "held out" if held_out else "used in the fit"
        most = "before and after differ most" if changed else "the model error is largest"
        caption = f"{run}, {role}. {OVERLAY.format(most=most)}"
        shown = tuple(channels)
        section = "held-out" if held_out else "fitted"
        yield Picture(
            f"overlay-{k}",
            section,
            caption,
            partial(overlay_figure, shown, changed),
            partial(overlay_chart, shown, changed),
        )


def _curves(found: Diagnosis) -> Iterator[Picture]:
    if found.curves:
        yield Picture("curves", "curves", CURVES, partial(law_curves, found.curves))


def _law(found: Diagnosis) -> Iterator[Picture]:
    if found.unknown and found.unknown.curves:
        yield Picture(
            "unknown-law", "unknown", LAW, partial(law_curves, found.unknown.curves, found.unknown.held_out)
        )


def _scores(found: Diagnosis) -> Iterator[Picture]:
    if found.scores:
        yield Picture("scores", "scores", SCORES, partial(scores, found))
