"""`FrequencyResponse.plot` and `Result.plot`: magnitude, phase and coherence, with the models over them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rover_sweep.drawing.axes import panels
from rover_sweep.errors import UsageError
from rover_sweep.identification.pipeline import Identification, ModelResult
from rover_sweep.report.identification.pictures import shown_models
from rover_sweep.report.pictures.frequency_response import draw_response
from rover_sweep.spectra.response import FrequencyResponse

ROWS = ("magnitude", "phase", "coherence")
HEIGHTS = {"height_ratios": (3, 2.4, 1.3), "sharex": "col"}


def draw_one_response(f: FrequencyResponse, axes: Any) -> Any:
    """Axes (3,) of magnitude, phase and coherence."""
    with panels(axes, (3, 1), ROWS, (6.0, 5.6), **HEIGHTS) as found:
        draw_response(found[:, 0], f, _span([f]))
        if f.input != "delta":
            found[0, 0].set_title(f"{f.output} / {f.input}, {f.unit}")
        found[0, 0].legend()
    return found[:, 0]


def draw_responses(
    result: Identification, outputs: Sequence[str] | None, models: Sequence[str] | None, group: int, axes: Any
) -> Any:
    """Axes (3, outputs) of the responses of a group of runs, with the models over them."""
    if not -len(result.groups) <= group < len(result.groups):
        raise UsageError(f"there is no group {group}; the result has {len(result.groups)} group(s) of runs")
    of = result.groups[group]
    wanted = _known(outputs, of.responses, "response")
    drawn = _drawn_models(result, models)
    names = [f"{row} of {o}" for row in ROWS for o in wanted]
    with panels(axes, (3, len(wanted)), names, (max(6.0, 4.9 * len(wanted)), 6.0), **HEIGHTS) as found:
        span = _span([of.responses[o] for o in wanted])
        for k, o in enumerate(wanted):
            draw_response(found[:, k], of.responses[o], span, of, drawn)
        found[0, 0].legend(fontsize="small")
    return found


def _drawn_models(result: Identification, names: Sequence[str] | None) -> Mapping[str, ModelResult]:
    """The models of these names; by default those of the report."""
    if names is None:
        return shown_models(result)
    return {n: result.models[n] for n in _known(names, result.models, "model")}


def _known(names: Sequence[str] | None, known: Mapping[str, Any], what: str) -> list[str]:
    wanted = [names] if isinstance(names, str) else list(known if names is None else names)
    for name in wanted:
        if name not in known:
            raise UsageError(f"there is no {what} {name!r}; choose from {', '.join(known)}")
    if not wanted:
        raise UsageError(f"there is no {what} to draw")
    return wanted


def _span(found: Sequence[FrequencyResponse]) -> tuple[float, float]:
    return 0.93 * float(min(f.w[0] for f in found)), 1.07 * float(max(f.w[-1] for f in found))
