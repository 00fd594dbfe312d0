"""The pictures of a comparison and of a corrected simulation."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial

from rover_sweep.comparison.answer import Bode
from rover_sweep.diagnosis.result import Overlay
from rover_sweep.report.charts.bode_chart import bode_chart
from rover_sweep.report.charts.overlay_chart import overlay_chart
from rover_sweep.report.pictures.bode import bode_figure
from rover_sweep.report.pictures.overlay import overlay_figure
from rover_sweep.report.pictures.picture import Picture

OVERLAY = (
    "Time history with the residual (recorded minus simulated), and its spectrum divided by the noise of "
    "both sides. Dashed or grey: twice that noise. In print, the shaded close-up is where before and after "
    "differ most."
)
BODE = "Responses to the steering. White: where the recording is coherent."


def planned_pictures(
    overlays: Sequence[Overlay], responses: Sequence[Bode], after: str
) -> tuple[Picture, ...]:
    """Time histories and responses, not drawn yet. after: what `after` is, in words."""
    return (*_histories(overlays, after), *_responses(responses, after))


def _histories(overlays: Sequence[Overlay], after: str) -> Iterator[Picture]:
    by_run: dict[tuple[str, bool], list[Overlay]] = {}
    for o in overlays:
        by_run.setdefault((o.run, o.held_out), []).append(o)
    for k, ((run, held_out), channels) in enumerate(by_run.items()):
        role, shown = "held out" if held_out else "used", tuple(channels)
        caption = f"{run}, {role}. Before: the simulation; after: {after}. {OVERLAY}"
        yield Picture(
            f"overlay-{k}",
            "histories",
            caption,
            partial(overlay_figure, shown),
            partial(overlay_chart, shown),
        )


def _responses(responses: Sequence[Bode], after: str) -> Iterator[Picture]:
    if responses:
        first, shown = responses[0], tuple(responses)
        role = "held out" if first.held_out else "used"
        caption = f"{first.run}, {role}. Before: the simulation; after: {after}. {BODE}"
        yield Picture("bode", "bode", caption, partial(bode_figure, shown), partial(bode_chart, shown))
