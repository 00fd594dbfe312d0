"""The charts of results on matplotlib axes: the user's, or those of a new figure."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

from rover_sweep.data.recording import Recording
from rover_sweep.diagnosis.result import Diagnosis, LawCurve
from rover_sweep.errors import UsageError
from rover_sweep.files.documents import printable
from rover_sweep.identification.identify_speed import SpeedResult
from rover_sweep.identification.model_results import ModelResult
from rover_sweep.identification.pipeline import Identification
from rover_sweep.identification.verify import Verification
from rover_sweep.report.charts.chart import (
    AFTER,
    CHANNEL_WORDS,
    DATA,
    DEGREES,
    Chart,
    Curve,
    Panel,
    Stack,
    shown_limits,
    ticks,
)
from rover_sweep.report.charts.diagnosis_charts import curves_chart, run_and_spectra
from rover_sweep.report.charts.response_charts import (
    response_chart,
    response_stack,
    run_chart,
    throttle_run_chart,
    verification_chart,
)
from rover_sweep.report.identification.report import shown_models
from rover_sweep.spectra.response import FrequencyResponse

COLUMN, ROW = 5.5, 0.0135  # in of a column, and of a px of a panel's height
LONG = 24  # characters from which the label of a panel takes two lines
STYLE: dict[Any, Any] = {
    "font.size": 10,
    "axes.titlesize": 10.5,
    "axes.titlelocation": "left",
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#D8D8D8",
    "grid.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.frameon": False,
    "legend.fontsize": 9.5,
    "figure.facecolor": "white",
}


def draw_chart(chart: Chart, axes: Any) -> Any:
    """Axes (panels, stacks) of a chart: those given (one, or a sequence or array of as many), or new ones.

    All stacks have as many panels. UsageError for another number of axes.
    """
    stacks = chart.stacks
    of = [f" of {stack.title}" if len(stacks) > 1 else "" for stack in stacks]
    panels = [[f"{p.label}{words}" for p in s.panels] for s, words in zip(stacks, of, strict=True)]
    names = [name for row in zip(*panels, strict=True) for name in row]
    shape = len(stacks[0].panels), len(stacks)
    if axes is not None:
        return _filled(_checked(axes, shape, names), stacks)
    from matplotlib import pyplot

    heights = [p.height for p in stacks[0].panels]
    size = max(COLUMN * len(stacks), 7.0), 1.0 + ROW * sum(heights)
    # outside the style: the first figure starts a notebook's backend, whose settings the style would undo
    figure = pyplot.figure(figsize=size, layout="constrained", facecolor="white")
    with matplotlib.rc_context(STYLE):
        return _filled(figure.subplots(*shape, squeeze=False, sharex="col", height_ratios=heights), stacks)


def _checked(given: Any, shape: tuple[int, int], names: Sequence[str]) -> Any:
    one = isinstance(given, Axes)
    flat = np.array([given], dtype=object) if one else np.array(given, dtype=object).ravel()
    wrong = [type(each).__name__ for each in flat if not isinstance(each, Axes)]
    if wrong:
        raise UsageError(f"axes holds a {wrong[0]}; give matplotlib axes, one for each of {', '.join(names)}")
    if flat.size != shape[0] * shape[1]:
        raise UsageError(f"{flat.size} axes were given, but {len(names)} are needed: {', '.join(names)}")
    return flat.reshape(shape)


def _filled(given: Any, stacks: Sequence[Stack]) -> Any:
    for column, stack in zip(given.T, stacks, strict=True):
        for axes, panel in zip(column, stack.panels, strict=True):
            _draw(axes, stack, panel)
        column[0].set_title(_literal(stack.title.replace("; ", "\n", 1)))
        column[-1].set_xlabel(_literal(stack.x_label))
        labelled = max(column, key=lambda axes: len(axes.get_legend_handles_labels()[1]))
        if len(labelled.get_legend_handles_labels()[1]) > 1:
            labelled.legend(fontsize="small")
    return given


def _draw(axes: Axes, stack: Stack, panel: Panel) -> None:
    if stack.kind == "log":
        axes.set_xscale("log")
        places = ticks(*stack.span, "log")
        axes.xaxis.set_major_locator(FixedLocator([x for x, _ in places]))
        axes.xaxis.set_minor_locator(NullLocator())
        axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    for low, high, colour in stack.shades:
        axes.axvspan(low, high, color=colour, linewidth=0, zorder=0)
    for x, colour in stack.marks:
        axes.axvline(x, color=colour, linewidth=1.2)
    for level in panel.levels:
        axes.axhline(level, color="#777777", linewidth=1.0, linestyle=(0, (4, 3)))
    for s in panel.spreads:
        axes.fill_between(panel.x, s.low, s.high, color=s.colour, alpha=0.75, linewidth=0, label=s.label)
    for line in panel.lines:
        axes.plot(
            panel.x,
            line.y,
            color=line.colour,
            linewidth=line.width,
            linestyle="none" if line.dots else (0, line.dash) if line.dash else "-",
            marker="." if line.dots else None,
            drawstyle="steps-post" if line.step else "default",
            label=_literal(line.label),
        )
    axes.set_xlim(*stack.span)
    axes.set_ylim(*shown_limits(panel))
    label = panel.label if len(panel.label) < LONG else panel.label.replace(", ", "\n", 1)
    axes.set_ylabel(_literal(label))


def _literal(text: str) -> str:
    """A text for a picture: `$` starts no formula, control characters are visible."""
    return "\n".join(printable(line) for line in text.split("\n")).replace("$", r"\$")


# `FullDiagnosis.plot`: a run measured and simulated; `.plot_curves`: the fitted laws.


def draw_diagnosis(found: Diagnosis, run: str | None, axes: Any) -> Any:
    """Axes (channels, 2): the signals over time, and the spectrum of the residual over the noise.

    run: by default the first held-out run, else the first one.
    """
    drawn = [o for o in found.overlays if o.t.size > 1]
    if not drawn:
        raise UsageError(
            "this diagnosis holds no signals to draw (neither has a diagnosis.json); "
            "load the file that FullDiagnosis.save wrote"
        )
    chosen = run or next((o.run for o in drawn if o.held_out), drawn[0].run)
    if not (channels := [o for o in drawn if o.run == chosen]):
        names = ", ".join(dict.fromkeys(o.run for o in drawn))
        raise UsageError(f"there is no run {chosen!r} in this diagnosis; it has {names}")
    return draw_chart(run_and_spectra(channels, bool(found.findings)), axes)


def draw_curves(curves: tuple[LawCurve, ...], axes: Any) -> Any:
    """Axes (n,): each law over its quantity, with its band."""
    if not curves:
        raise UsageError("this diagnosis has no curves: its model has no tyres, or it was refused")
    return draw_chart(curves_chart(curves), axes)[0]


# `ModelResult.plot` and `Verification.plot`: a run that was not fitted, measured and predicted.


def draw_model(model: ModelResult, axes: Any) -> Any:
    """Axes (channels,) of the first verification run. UsageError for a model without one."""
    if not model.verification:
        raise UsageError(
            f"the {model.fit.structure.name} model was verified on no run, so there is nothing to draw; give "
            "rs.identify(runs, verify=...) a doublet, or use result.plot() for the responses"
        )
    return draw_verification(model.verification[0], model.fit.structure.name, axes)


def draw_verification(found: Verification, model: str, axes: Any) -> Any:
    """Axes (channels,) of measured and predicted channels over time [s]."""
    return draw_chart(verification_chart(None, {model: found}), axes)[:, 0]


def draw_simulation(
    title: str, t: Any, signals: Any, measured: Any, channels: Sequence[str] | None, axes: Any
) -> Any:
    """Axes (channels,) of simulated and measured channels over time. signals, measured: {channel: (n,)}."""
    both = [c for c in signals if c in measured] or list(signals)
    panels = []
    for name in _chosen(channels or both, signals, "the model", "channel"):
        factor = 180 / np.pi if name in DEGREES else 1.0
        lines = [Curve("measured", factor * measured[name], DATA, width=1.0)] if name in measured else []
        lines.append(Curve("simulated", factor * signals[name], **AFTER))
        panels.append(Panel(CHANNEL_WORDS.get(name, name), t - t[0], tuple(lines), height=140))
    stack = Stack(title, "time, s", tuple(panels), (0.0, float(t[-1] - t[0])))
    return draw_chart(Chart((stack,)), axes)[:, 0]


# `FrequencyResponse.plot` and `Result.plot`: magnitude, phase and coherence, with the models over them.


def draw_one_response(f: FrequencyResponse, axes: Any) -> Any:
    """Axes (3,) of magnitude, phase and coherence."""
    return draw_chart(Chart((response_stack(f),)), axes)[:, 0]


def draw_responses(
    result: Identification, outputs: Sequence[str] | None, models: Sequence[str] | None, group: int, axes: Any
) -> Any:
    """Axes (3, outputs) of the responses of a group of runs, with the models over them."""
    if not -len(result.groups) <= group < len(result.groups):
        raise UsageError(f"there is no group {group}; the result has {len(result.groups)} group(s) of runs")
    of = result.groups[group]
    wanted = _chosen(
        list(of.responses) if outputs is None else outputs, of.responses, "the result", "response"
    )
    drawn = shown_models(result)
    if models:
        drawn = {n: result.models[n] for n in _chosen(models, result.models, "the result", "model")}
    chart = response_chart(of, drawn, outputs=wanted)
    return draw_chart(chart, axes)


def _chosen(names: str | Sequence[str], known: Collection[str], owner: str, what: str) -> list[str]:
    """The names as a list; UsageError for an unknown one, and for none."""
    wanted = [names] if isinstance(names, str) else list(names)
    if not wanted:
        raise UsageError(f"no {what} is named; choose from {', '.join(known)}")
    if missing := [name for name in wanted if name not in known]:
        raise UsageError(f"{owner} has no {what} {missing[0]!r}; it has {', '.join(known)}")
    return wanted


# `Recording.plot` and `Runs.plot`: the channels over time.


def draw_run(run: Recording, channels: Sequence[str] | None, axes: Any) -> Any:
    """Axes (n,) of the channels of one run over the time since its manoeuvre began."""
    return draw_chart(run_chart(run, channels=_shown(run, channels)), axes)[:, 0]


def draw_runs(runs: Sequence[Recording], channels: Sequence[str] | None, axes: Any) -> Any:
    """Axes (channels, runs): a column for each run. UsageError without a run."""
    if not runs:
        raise UsageError("there is no run to draw")
    common = [c for c in _shown(runs[0], None) if all(c in run for run in runs)]
    stacks = [run_chart(run, channels=_shown(run, channels or common)).stacks[0] for run in runs]
    return draw_chart(Chart(tuple(stacks), len(stacks)), axes)


def _shown(run: Recording, channels: Sequence[str] | None) -> list[str]:
    """The channels asked for; by default the steering and the motion."""
    if channels is None:
        steering = next((c for c in ("pwm", "delta") if c in run), None)
        return [c for c in (steering, "r", "ay", "p", "speed") if c is not None and c in run]
    return _chosen(channels, run.channels, run.name, "channel")


# `SpeedIdentification.plot`: throttle and speed over time, with the speed that the law simulates.


def draw_speed(result: SpeedResult, axes: Any) -> Any:
    """Axes (2, runs) of throttle [%] and speed [m/s]."""
    stacks = [throttle_run_chart(run, result.fit, k).stacks[0] for k, run in enumerate(result.runs)]
    return draw_chart(Chart(tuple(stacks), len(stacks)), axes)
