"""The axes to draw on: the user's, or those of a new figure in the style of the reports."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from rover_sweep.data.recording import Recording
from rover_sweep.diagnosis.result import Diagnosis, LawCurve, TimeHistory
from rover_sweep.errors import UsageError
from rover_sweep.identification.identify_speed import SpeedResult
from rover_sweep.identification.model_results import ModelResult
from rover_sweep.identification.pipeline import Identification
from rover_sweep.identification.speed_fit import fitted_speed, grid_of
from rover_sweep.identification.verify import Verification
from rover_sweep.report.identification.page import shown_models
from rover_sweep.report.pictures.frequency_response import (
    DEG,
    MARGIN,
    ROWS,
    draw_channel,
    draw_predicted,
    draw_response,
)
from rover_sweep.report.pictures.overlay import HEIGHT, draw_curve, draw_overlay, draw_residual
from rover_sweep.report.pictures.picture import DATA, LABELS, MODEL_LINES, WIDTH, literal, styled
from rover_sweep.report.wording import LONG_CHANNELS
from rover_sweep.spectra.response import FrequencyResponse


@contextmanager
def panels(
    given: Any, shape: tuple[int, int], names: Sequence[str], size: tuple[float, float], **grid: Any
) -> Iterator[Any]:
    """Axes (rows, columns): those given (one, or a sequence or array of as many), or new ones.

    names: of the panels, for the error; size: of a new figure [in]; grid: further arguments of
    `Figure.subplots`. UsageError for another number of axes.
    """
    if given is not None:
        yield _checked(given, shape, names)
        return
    from matplotlib import pyplot

    # outside the style: the first figure starts a notebook's backend, whose settings the style would undo
    figure = pyplot.figure(figsize=size, layout="constrained", facecolor="white")
    with styled():
        yield figure.subplots(*shape, squeeze=False, **grid)


def _checked(given: Any, shape: tuple[int, int], names: Sequence[str]) -> Any:
    flat = (
        np.array([given], dtype=object) if isinstance(given, Axes) else np.array(given, dtype=object).ravel()
    )
    wrong = [type(one).__name__ for one in flat if not isinstance(one, Axes)]
    if wrong:
        raise UsageError(f"axes holds a {wrong[0]}; give matplotlib axes, one for each of {', '.join(names)}")
    if flat.size != shape[0] * shape[1]:
        raise UsageError(f"{flat.size} axes were given, but {len(names)} are needed: {', '.join(names)}")
    return flat.reshape(shape)


# `FullDiagnosis.plot`: a run measured and simulated; `.plot_curves`: the fitted laws.


DIAGNOSIS_ROW = 2.0  # in


def draw_diagnosis(found: Diagnosis, run: str | None, axes: Any) -> Any:
    """Axes (channels, 2): the signals over time, and the spectrum of the residual over the noise."""
    channels = _channels(found, run)
    changed = bool(found.findings)
    names = [f"{what} of {o.channel}" for o in channels for what in ("signal", "residual")]
    shape, size = (len(channels), 2), (WIDTH, 0.7 + DIAGNOSIS_ROW * len(channels))
    with panels(axes, shape, names, size, width_ratios=(2.3, 1)) as given:
        for k, (row, o) in enumerate(zip(given, channels, strict=True)):
            draw_overlay(row[0], o, changed, last=k == len(channels) - 1)
            draw_residual(row[1], o, changed)
            row[0].set_ylabel(LONG_CHANNELS.get(o.channel, o.channel))
        role = "held out" if channels[0].held_out else "used in the fit"
        given[0, 0].set_title(f"{literal(channels[0].run)}, {role}")
        given[0, 0].legend(fontsize="small", ncols=4)
        given[0, 1].set_title("residual / noise")
        given[-1, 0].set_xlabel("time, s")
        given[-1, 1].set_xlabel("frequency, rad/s")
    return given


def draw_curves(curves: tuple[LawCurve, ...], axes: Any) -> Any:
    """Axes (n,): each law over its quantity, with its band."""
    if not curves:
        raise UsageError("this diagnosis has no curves: its model has no tyres, or it was refused")
    names = [curve.place for curve in curves]
    with panels(axes, (1, len(curves)), names, (0.5 * WIDTH * len(curves), HEIGHT)) as given:
        for curve, panel in zip(curves, given.ravel(), strict=True):
            draw_curve(curve, panel)
    return given.ravel()


def _channels(found: Diagnosis, run: str | None) -> list[TimeHistory]:
    """The overlays of a run; by default of the first held-out run, else of the first one."""
    drawn = [o for o in found.overlays if o.t.size > 1]
    if not drawn:
        raise UsageError(
            "this diagnosis holds no signals to draw (neither has a diagnosis.json); "
            "load the file that FullDiagnosis.save wrote"
        )
    names = list(dict.fromkeys(o.run for o in drawn))
    chosen = run or next((o.run for o in drawn if o.held_out), names[0])
    if chosen not in names:
        raise UsageError(f"there is no run {chosen!r} in this diagnosis; it has {', '.join(names)}")
    return [o for o in drawn if o.run == chosen]


# `ModelResult.plot` and `Verification.plot`: a run that was not fitted, measured and predicted.


MODEL_ROW = 1.9  # in
SHOWN_IN = {"r": (180 / np.pi, "deg/s"), "p": (180 / np.pi, "deg/s")}
UNITS = {"ay": "m/s²", "vy": "m/s", "vydot": "m/s²"}


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
    names = [o.channel for o in found.overlays]
    with panels(axes, (len(names), 1), names, (WIDTH, 0.7 + MODEL_ROW * len(names)), sharex=True) as given:
        for one, channel in zip(given[:, 0], names, strict=True):
            draw_predicted(one, channel, {model: found}, float(found.overlays[0].t[0]))
        given[0, 0].set_title(f"{found.run} at {found.speed:.2f} m/s")
        given[0, 0].legend()
        given[-1, 0].set_xlabel("time since start of the manoeuvre, s")
    return given[:, 0]


def draw_simulation(
    title: str, t: Any, signals: Any, measured: Any, channels: Sequence[str] | None, axes: Any
) -> Any:
    """Axes (channels,) of simulated and measured channels over time. signals, measured: {channel: (n,)}."""
    wanted = [channels] if isinstance(channels, str) else list(channels or _both(signals, measured))
    if unknown := [c for c in wanted if c not in signals]:
        raise UsageError(f"the model has no channel {unknown[0]!r}; it has {', '.join(signals)}")
    with panels(axes, (len(wanted), 1), wanted, (WIDTH, 0.7 + MODEL_ROW * len(wanted)), sharex=True) as found:
        for one, channel in zip(found[:, 0], wanted, strict=True):
            factor, unit = SHOWN_IN.get(channel, (1.0, UNITS.get(channel, "")))
            if channel in measured:
                one.plot(t - t[0], factor * measured[channel], color=DATA, linewidth=0.9, label="measured")
            one.plot(t - t[0], factor * signals[channel], label="simulated", **MODEL_LINES["roll-yaw"])
            one.set_ylabel(f"{LABELS.get(channel, channel)}\n{unit}")
        found[0, 0].set_title(title)
        found[0, 0].legend()
        found[-1, 0].set_xlabel("time, s")
    return found[:, 0]


def _both(signals: Any, measured: Any) -> list[str]:
    return [c for c in signals if c in measured] or list(signals)


# `FrequencyResponse.plot` and `Result.plot`: magnitude, phase and coherence, with the models over them.


RESPONSE_ROWS = ("magnitude", "phase", "coherence")
HEIGHTS = {"height_ratios": (3, 2.4, 1.3), "sharex": "col"}


def draw_one_response(f: FrequencyResponse, axes: Any) -> Any:
    """Axes (3,) of magnitude, phase and coherence."""
    with panels(axes, (3, 1), RESPONSE_ROWS, (6.0, 5.6), **HEIGHTS) as found:
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
    names = [f"{row} of {o}" for row in RESPONSE_ROWS for o in wanted]
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


# `Recording.plot` and `Runs.plot`: the channels over time.


STEERING = (("pwm", "steering\nPWM, µs", 1.0), ("delta", "road-wheel\nangle, deg", DEG))
MORE = (
    ("phi", "roll angle\ndeg", DEG),
    ("psi", "heading\ndeg", DEG),
    ("vy", "lateral\nspeed, m/s", 1.0),
    ("throttle", "throttle\nPWM, µs", 1.0),
)
LABELLED = {row[0]: row for row in (*STEERING, *ROWS, *MORE)}
RUN_ROW = 1.35  # in


def draw_run(run: Recording, channels: Sequence[str] | None, axes: Any) -> Any:
    """Axes (n,) of the channels of one run over the time since its manoeuvre began."""
    rows = _rows(run, channels)
    with panels(
        axes, (len(rows), 1), [r[0] for r in rows], (WIDTH, 0.9 + RUN_ROW * len(rows)), sharex=True
    ) as found:
        _column(found[:, 0], run, rows)
    return found[:, 0]


def draw_runs(runs: Sequence[Recording], channels: Sequence[str] | None, axes: Any) -> Any:
    """Axes (channels, runs): a column for each run. UsageError without a run."""
    if not runs:
        raise UsageError("there is no run to draw")
    rows = [_rows(run, channels or _common(runs)) for run in runs]
    names = [f"{row[0]} of {run.name}" for row in rows[0] for run in runs]
    shape, size = (len(rows[0]), len(runs)), (max(WIDTH, 4.2 * len(runs)), 0.9 + RUN_ROW * len(rows[0]))
    with panels(axes, shape, names, size, sharex="col") as found:
        for k, run in enumerate(runs):
            _column(found[:, k], run, rows[k], labelled=k == 0)
    return found


def _common(runs: Sequence[Recording]) -> list[str]:
    """The channels drawn of the first run that all runs have."""
    first = [row[0] for row in _rows(runs[0], None)]
    return [c for c in first if all(c in run for run in runs)]


def _rows(run: Recording, channels: Sequence[str] | None) -> list[tuple[str, str, float]]:
    """(channel, label, factor) of those asked for; by default the steering and the motion."""
    if channels is None:
        steering = next((row for row in STEERING if row[0] in run), None)
        return [row for row in (steering, *ROWS) if row is not None and row[0] in run]
    wanted = (channels,) if isinstance(channels, str) else tuple(channels)
    if not wanted:
        raise UsageError(f"no channel is named; choose from {', '.join(run.channels)}")
    if missing := [c for c in wanted if c not in run]:
        raise UsageError(f"{run.name} has no channel {missing[0]!r}; it has {', '.join(run.channels)}")
    return [LABELLED.get(c, (c, f"{c}\n{run[c].unit}", 1.0)) for c in wanted]


def _column(
    column: Any, run: Recording, rows: Sequence[tuple[str, str, float]], labelled: bool = True
) -> None:
    for one, row in zip(column, rows, strict=True):
        draw_channel(one, run, *row)
        one.yaxis.set_label_coords(-0.075, 0.5)
        if not labelled:
            one.set_ylabel("")
    speed = f", mean speed {run.mean_speed:.2f} m/s" if "speed" in run else ""
    column[0].set_title(f"{literal(run.name)}: {run.kind}{speed}")
    column[-1].set_xlim(-MARGIN, run.span[1] - run.span[0] + MARGIN)
    column[-1].set_xlabel("time since start of the manoeuvre, s")


# `SpeedIdentification.plot`: throttle and speed over time, with the speed that the law simulates.


def draw_speed(result: SpeedResult, axes: Any) -> Any:
    """Axes (2, runs) of throttle [%] and speed [m/s]."""
    names = [f"{row} of {run.name}" for row in ("throttle", "speed") for run in result.runs]
    size = max(6.0, 5.5 * len(result.runs)), 4.6
    with panels(axes, (2, len(result.runs)), names, size, sharex="col") as found:
        for k, run in enumerate(result.runs):
            t = grid_of(run)
            found[0, k].plot(t - t[0], 100 * run.drive(t), color=DATA, linewidth=0.9)
            found[1, k].plot(t - t[0], run.speed.on(t), color=DATA, linewidth=0.9, label="measured")
            if result.fit is not None:
                _, law = fitted_speed(result.fit, run, result.fit.starts[k])
                found[1, k].plot(t - t[0], law, label="simulated by the law", **MODEL_LINES["roll-yaw"])
            found[0, k].set_title(literal(run.name))
            found[1, k].set_xlabel("time since the sweep began, s")
        found[0, 0].set_ylabel("throttle, %")
        found[1, 0].set_ylabel("speed, m/s")
        found[1, 0].legend()
    return found
