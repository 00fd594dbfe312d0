"""Frequency responses with coherence, the models over them, and the models' error over frequency."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from types import MappingProxyType

import numpy as np

from rover_sweep.data.recording import Array, Complex, Recording, ThrottleRun
from rover_sweep.gains.speed_chain import BEFORE as STEP_AT
from rover_sweep.gains.speed_chain import driven_step
from rover_sweep.gains.speed_proposal import SpeedProposal
from rover_sweep.identification.fit import costs
from rover_sweep.identification.grouping import Group
from rover_sweep.identification.identify_speed import GOOD, ThrottleCoherence
from rover_sweep.identification.model_results import ModelResult
from rover_sweep.identification.speed_fit import PERIOD, SpeedFit, fitted_speed
from rover_sweep.identification.verify import Verification
from rover_sweep.report.charts.chart import (
    AFTER,
    BEFORE,
    CHANNEL_WORDS,
    DATA,
    DEGREES,
    MARK,
    OUTSIDE,
    QUIET,
    Chart,
    Curve,
    Panel,
    Spread,
    Stack,
    model_colours,
)
from rover_sweep.report.wording import FOOT, OUTPUT_NAMES, SI, ShownUnits
from rover_sweep.season.season_result import Drift, TrackedQuantity
from rover_sweep.spectra.response import (
    COHERENCE_GOOD,
    FrequencyResponse,
    inside_band,
    nearest_turn,
    unwrapped_phase,
)

Models = Mapping[str, ModelResult]
_NONE: Models = MappingProxyType({})


def response_chart(
    group: Group, models: Models, units: ShownUnits = SI, outputs: Sequence[str] | None = None
) -> Chart:
    """Magnitude, phase (with two standard deviations) and coherence, measured and of the models."""
    shown = [group.responses[o] for o in (group.responses if outputs is None else outputs)]
    return Chart(tuple(response_stack(f, group, models, units) for f in shown), columns=2)


def error_chart(group: Group, models: Models) -> Chart:
    """|model / measured - 1| in percent over frequency, with two standard deviations of the measurement."""
    having = [f for f in group.responses.values() if f.band and _lines(f, group, models)]
    return Chart(tuple(_error(f, group, models) for f in having), columns=2)


def _lines(f: FrequencyResponse, group: Group | None, models: Models) -> dict[str, Complex]:
    if group is None:
        return {}
    filters = group.runs[0].filters
    return {
        name: m.fit.structure.response(f.w, group.speed, f.output, filters)
        for name, m in models.items()
        if f.output in m.fit.structure.outputs
    }


def response_stack(
    f: FrequencyResponse, group: Group | None = None, models: Models = _NONE, units: ShownUnits = SI
) -> Stack:
    """One response; models only with the group of f."""
    error = np.clip(2 * np.nan_to_num(f.random_error, nan=1.0), 0, 0.95)
    more = units.db(f.unit)
    db, deg, spread = f.magnitude_db + more, unwrapped_phase(f.h, f), np.degrees(np.arcsin(error))
    found = _lines(f, group, models)
    models_db = {n: 20 * np.log10(np.abs(h)) + more for n, h in found.items()}
    models_deg = {n: nearest_turn(unwrapped_phase(h, f), deg, f) for n, h in found.items()}
    sd = "random error, 2 sd"
    measured = Curve("measured", deg, DATA, width=2.0, dots=not f.band)
    return bode_stack(
        _title(f, group, models, units),
        f.w,
        f.band,
        (Curve("measured", db, DATA, width=2.0), *_drawn(models_db, models)),
        (measured, *_drawn(models_deg, models)),
        Curve("partial coherence" if f.conditioned_on else "coherence", f.coherence, DATA),
        (COHERENCE_GOOD,),
        spreads=(
            (Spread(sd, db + 20 * np.log10(1 - error), db + 20 * np.log10(1 + error)),),
            (Spread(sd, deg - spread, deg + spread),) if f.band else (),
        ),
    )


def bode_stack(
    title: str,
    w: Array,
    band: tuple[float, float] | None,
    magnitude: tuple[Curve, ...],
    phase: tuple[Curve, ...],
    coherence: Curve,
    levels: tuple[float, ...] = (),
    least: float = 100,
    heights: tuple[int, int, int] = (170, 140, 80),
    spreads: tuple[tuple[Spread, ...], tuple[Spread, ...]] = ((), ()),
) -> Stack:
    """Magnitude [dB], phase [deg] and coherence over w (n,) [rad/s]; grey outside of the usable band.

    levels: of the coherence. least: range of the phase. heights: of the panels [px].
    """
    low, high = band or (float(w[0]), float(w[-1]))
    inside = (w >= low * 0.999) & (w <= high * 1.001)
    rows = zip(
        ("magnitude, dB", "phase, deg"), (magnitude, phase), spreads, (20, least), heights, strict=False
    )
    panels = [
        Panel(label, w, lines, areas, limits_around([line.y[inside] for line in lines], apart), height=height)
        for label, lines, areas, apart, height in rows
    ]
    panels.append(
        Panel(coherence.label, w, (coherence,), limits=(0.0, 1.04), levels=levels, height=heights[2])
    )
    shades = ((1e-3, low if band else high, OUTSIDE), (high, 1e4, OUTSIDE))
    marks = ((low, MARK), (high, MARK)) if band else ()
    span = 0.93 * float(w[0]), 1.07 * float(w[-1])
    return Stack(title, "frequency, rad/s", tuple(panels), span, "log", shades, marks)


def _drawn(lines: Mapping[str, Array], models: Models) -> list[Curve]:
    return [Curve(f"{n} model", y, **model_colours(n, models)) for n, y in lines.items()]


def _error(f: FrequencyResponse, group: Group, models: Models) -> Stack:
    inside = inside_band(f)
    low, high = f.band or (float(f.w[0]), float(f.w[-1]))
    w = f.w[inside]
    errors = {n: 100 * np.abs(h[inside] / f.h[inside] - 1) for n, h in _lines(f, group, models).items()}
    noise = 200 * np.nan_to_num(f.random_error[inside], nan=1.0)
    seen = np.concatenate([*errors.values(), noise])
    panel = Panel(
        "error, %",
        w,
        tuple(_drawn(errors, models)),
        (Spread("random error, 2 sd", np.zeros(w.size), noise),),
        (0.0, float(np.clip(1.1 * np.percentile(seen, 98), 10, 200))),
        height=130,
    )
    title = f"{OUTPUT_NAMES[f.output]} / steering"
    return Stack(title, "frequency, rad/s", (panel,), (0.97 * low, 1.03 * high), "log")


def _title(f: FrequencyResponse, group: Group | None, models: Models, units: ShownUnits) -> str:
    """The response and its unit, and J of each model."""
    without = f" without {', '.join(f.conditioned_on)}" if f.conditioned_on else ""
    output, over = OUTPUT_NAMES.get(f.output, f.output), "steering" if f.input == "delta" else f.input
    what = f"{output} / {over}{without}, {units.words(f.unit.replace('^2', '²'))}"
    if not f.band:
        return f"{what}: no usable band"
    if group is None:
        return what
    seen = [group.condition((f.output,))]
    having = {n: m.fit.structure for n, m in models.items() if f.output in m.fit.structure.outputs}
    grades = [f"{name} {costs(structure, seen)[f.output]:.1f}" for name, structure in having.items()]
    fitted = any(f.output in m.fit.costs for m in models.values())
    return f"{what}; J {', '.join(grades)}{'' if fitted else ' (not in the fit)'}" if grades else what


def limits_around(values: list[Array], least: float) -> tuple[float, float]:
    """Limits around all finite values, with a margin, at least `least` apart."""
    x = np.concatenate([v[np.isfinite(v)] for v in values])
    low, high = (float(x.min()), float(x.max())) if x.size else (0.0, 0.0)
    spare = max(0.08 * (high - low), (least - (high - low)) / 2)
    return low - spare, high + spare


# Time histories of a run.


MARGIN = 4.0  # s shown before and after the manoeuvre


def run_chart(run: Recording, units: ShownUnits = SI, channels: Sequence[str] | None = None) -> Chart:
    """Steering, yaw rate, lateral acceleration, roll rate and speed over time since the manoeuvre began."""
    start, end = run.span
    names = channels or [c for c in ("pwm", "delta", "r", "ay", "p", "speed") if c in run]
    panels = tuple(_panel(run, name, units) for name in names)
    length = end - start
    quiet = [(a - start, b - start, QUIET) for a, b in (*run.standstill, *run.straight)]
    outside = [(-MARGIN, 0.0, OUTSIDE), (length, length + MARGIN, OUTSIDE)]
    speed = f", mean speed {run.mean_speed:.2f} m/s" if "speed" in run else ""
    title = f"{run.name}: {run.kind}{speed}"
    span = (-MARGIN, length + MARGIN)
    shades = (
        *outside,
        *((max(a, span[0]), min(b, span[1]), c) for a, b, c in quiet if a < span[1] and b > span[0]),
    )
    return Chart((Stack(title, "time since start of the manoeuvre, s", panels, span, shades=shades),))


def _panel(run: Recording, name: str, units: ShownUnits) -> Panel:
    start, end = run.span
    factor = 180 / np.pi if name in DEGREES else units.factor(run[name].unit)
    shown = run[name].between(start - MARGIN, end + MARGIN)
    inside = run.manoeuvre(name).x
    x = (inside if inside.size else shown.x) * factor
    spare = 0.12 * (float(np.ptp(x)) or 1.0)  # limits of the manoeuvre: start and stop do not compress it
    words = CHANNEL_WORDS.get(name, f"{name}, {shown.unit}")
    line = Curve(words.partition(",")[0], shown.x * factor, DATA, width=1.0, step=shown.hold)
    limits = float(x.min()) - spare, float(x.max()) + spare
    return Panel(units.words(words), shown.t - start, (line,), limits=limits, height=84)


# The quantities of a vehicle over the days of a season.


DAY = 86400.0  # s


def season_chart(quantities: Sequence[TrackedQuantity], drifts: Sequence[Drift]) -> Chart:
    """A small chart of each quantity with its 90 % interval, the changed ones first, changes shaded."""
    changed = {d.quantity: d for d in drifts if d.kind in ("gradual", "step")}
    ordered = sorted(quantities, key=lambda q: q.name not in changed)
    return Chart(tuple(_course(q, changed.get(q.name)) for q in ordered if q.days), columns=3)


def _course(q: TrackedQuantity, drift: Drift | None) -> Stack:
    t = np.array([_seconds(d.day) for d in q.days])
    value, low, high, fitted = (
        np.array([getattr(d, name) for d in q.days]) for name in ("value", "low", "high", "fitted")
    )
    course = Curve(
        "course", fitted, MARK if drift else "#777777", step=drift is not None and drift.kind == "step"
    )
    shown = f", {q.unit}" if q.unit and "vehicle file" not in q.unit else ""
    panel = Panel(
        q.name,
        t,
        (course, Curve("value", value, DATA, dots=True)),
        (Spread("90 % interval", low, high),),
        height=130,
    )
    shades = (
        () if drift is None else ((_seconds(drift.earliest) - DAY, _seconds(drift.latest) + DAY, "#FBE9C6"),)
    )
    title = f"{q.name}{shown}" + (": changed" if drift else "")
    return Stack(title, "", (panel,), (float(t[0]) - DAY, float(t[-1]) + DAY), "date", shades)


def _seconds(day: str) -> float:
    return datetime.fromisoformat(day).replace(tzinfo=UTC).timestamp()


# Models with the steering of a verification run as input.


def verification_chart(
    run: Recording | None, verdicts: Mapping[str, Verification], units: ShownUnits = SI
) -> Chart:
    """Steering of `run` (if given), and each channel measured and predicted by every model."""
    channels = [
        c for c in ("r", "ay", "p") if any(o.channel == c for v in verdicts.values() for o in v.overlays)
    ]
    first = next(iter(verdicts.values()))
    start = run.span[0] if run is not None else float(first.overlays[0].t[0])
    panels = [_channel(c, verdicts, start, units) for c in channels]
    if run is not None and "delta" in run:
        delta = run.manoeuvre("delta")
        line = Curve("steering", np.degrees(delta.x), DATA, width=1.0, step=delta.hold)
        panels.insert(0, Panel("steering, deg", delta.t - start, (line,), height=84))
    end = max(float(p.x[-1]) for p in panels)
    grade = ", ".join(f"{n}: J_rms {v.j_rms:.2f}, TIC {v.tic:.3f}" for n, v in verdicts.items())
    title = f"{first.run}; {grade}"
    return Chart((Stack(title, "time since start of the manoeuvre, s", tuple(panels), (0.0, end)),))


def _channel(channel: str, verdicts: Mapping[str, Verification], start: float, units: ShownUnits) -> Panel:
    found = {n: o for n, v in verdicts.items() for o in v.overlays if o.channel == channel}
    first = next(iter(found.values()))
    factor = FOOT * units.per_si if first.unit.startswith("ft") else 1.0
    lines = [Curve("measured", first.measured * factor, DATA, width=1.0)]
    for n, o in found.items():  # on the grid of the first model; the same one unless their runs differ
        y = o.model if o.t.size == first.t.size else np.interp(first.t, o.t, o.model)
        lines.append(Curve(n, y * factor, **model_colours(n, verdicts)))
    return Panel(units.words(CHANNEL_WORDS[channel]), first.t - start, tuple(lines), height=140)


# A throttle sweep as it was driven, the speed's response to the throttle, and the predicted step.


AHEAD, COASTED = 3.0, 8.0  # s shown before and after the sweep
SHOWN = 5.0  # s of a predicted step


def throttle_run_chart(run: ThrottleRun, fit: SpeedFit | None, k: int) -> Chart:
    """Throttle and speed over time, with the law's speed. k: index of the run in the fit."""
    start, end = run.span
    first = max(start - AHEAD, run.pwm.t[0], run.speed.t[0])
    last = min(end + COASTED, run.pwm.t[-1], run.speed.t[-1])
    t = start + PERIOD * np.arange(np.ceil((first - start) / PERIOD), (last - start) // PERIOD)
    speeds = [Curve("measured", run.speed.on(t), DATA, width=1.2)]
    if fit is not None:
        at, v = fitted_speed(fit, run, fit.starts[k])
        within = (t >= at[0] - PERIOD / 2) & (t <= at[-1] + PERIOD / 2)
        law = np.where(within, np.interp(t, at, v), np.nan)
        speeds.append(Curve("simulated by the law", law, **AFTER))
    x = t - start
    panels = (
        Panel("throttle, %", x, (Curve("throttle", 100 * run.drive(t), DATA, width=1.2, step=True),)),
        Panel("speed, m/s", x, tuple(speeds), height=170),
    )
    outside = ((-AHEAD, 0.0, OUTSIDE), (end - start, end - start + COASTED, OUTSIDE))
    words = f"{run.name}: throttle sweep of {end - start:.0f} s"
    span = float(x[0]), float(x[-1])
    return Chart((Stack(words, "time since the sweep began, s", panels, span, shades=outside),))


def throttle_response_chart(found: ThrottleCoherence, fit: SpeedFit) -> Chart:
    """Gain, phase and coherence of the speed to the throttle, measured and of the law."""
    w, h = found.w, fit.model.response(found.w)
    low, high = found.band or (float(w[0]), float(w[-1]))
    inside = (w >= 0.999 * low) & (w <= 1.001 * high)
    law_deg, deg = np.degrees(np.unwrap(np.angle(h))), np.degrees(found.phase)
    deg = deg - 360.0 * np.round(float(np.median((deg - law_deg)[inside])) / 360.0)
    measured_db, law_db = 20 * np.log10(np.maximum(found.gain, 1e-9)), 20 * np.log10(np.abs(h))
    stack = bode_stack(
        "speed / throttle, m/s per full throttle",
        w,
        found.band,
        (Curve("measured", measured_db, DATA, width=2.0), Curve("law", law_db, **AFTER)),
        (Curve("measured", deg, DATA, width=2.0), Curve("law", law_deg, **AFTER)),
        Curve("coherence", found.coherence, DATA),
        (GOOD,),
        60,
    )
    return Chart((stack,))


def speed_step_chart(proposal: SpeedProposal) -> Chart:
    """The predicted step of the commanded speed, with the current and the proposed settings."""
    tuned = proposal.tuned or proposal.loop
    drives = [
        (words, style, driven_step(loop, plant, judged.settings, judged.step.start, judged.step.size))
        for words, style, loop, judged in (
            ("now", BEFORE, proposal.loop, proposal.now),
            ("proposed", AFTER, tuned, proposal.proposed),
        )
        if judged is not None and (plant := proposal.found.plant) is not None
    ]
    wanted, first = drives[0][2]
    x = first.t - STEP_AT
    kept = x <= SHOWN
    speeds = [Curve("commanded", wanted[kept], DATA, dash=(2, 2), step=True)]
    speeds += [Curve(words, d.speed[kept, 0], **style) for words, style, (_, d) in drives]
    throttle = [Curve(words, 100 * d.throttle[kept, 0], **style) for words, style, (_, d) in drives]
    panels = (
        Panel("speed, m/s", x[kept], tuple(speeds), height=170),
        Panel("throttle, %", x[kept], tuple(throttle)),
    )
    assert proposal.now is not None
    step = proposal.now.step
    words = f"predicted step from {step.start:.2f} to {step.start + step.size:.2f} m/s"
    return Chart((Stack(words, "time since the step, s", panels, (-STEP_AT, SHOWN)),))
