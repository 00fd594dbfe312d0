"""Frequency responses with coherence, the models over them, and the models' error over frequency."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.identification.cost import costs
from rover_sweep.identification.grouping import Group
from rover_sweep.identification.pipeline import ModelResult
from rover_sweep.report.charts.chart import Chart, Curve, Panel, Spread, Stack
from rover_sweep.report.charts.colours import DATA, MARK, OUTSIDE, RESPONSE_WORDS, model_colours
from rover_sweep.report.wording.shown_units import SI, ShownUnits
from rover_sweep.spectra.response import COHERENCE_GOOD, FrequencyResponse
from rover_sweep.spectra.unwrapped import inside_band, nearest_turn, unwrapped_phase
from rover_sweep.spectra.windowed import Complex

Models = Mapping[str, ModelResult]


def response_chart(group: Group, models: Models, units: ShownUnits = SI) -> Chart:
    """Magnitude, phase (with two standard deviations) and coherence, measured and of the models."""
    return Chart(tuple(_bode(f, group, models, units) for f in group.responses.values()), columns=2)


def error_chart(group: Group, models: Models) -> Chart:
    """|model / measured - 1| in percent over frequency, with two standard deviations of the measurement."""
    having = [f for f in group.responses.values() if f.band and _lines(f, group, models)]
    return Chart(tuple(_error(f, group, models) for f in having), columns=2)


def _lines(f: FrequencyResponse, group: Group, models: Models) -> dict[str, Complex]:
    filters = group.runs[0].filters
    return {
        name: m.fit.structure.response(f.w, group.speed, f.output, filters)
        for name, m in models.items()
        if f.output in m.fit.structure.outputs
    }


def _bode(f: FrequencyResponse, group: Group, models: Models, units: ShownUnits) -> Stack:
    error = np.clip(2 * np.nan_to_num(f.random_error, nan=1.0), 0, 0.95)
    more = units.db(f.unit)
    db, deg, spread = f.magnitude_db + more, unwrapped_phase(f.h, f), np.degrees(np.arcsin(error))
    found = _lines(f, group, models)
    models_db = {n: 20 * np.log10(np.abs(h)) + more for n, h in found.items()}
    models_deg = {n: nearest_turn(unwrapped_phase(h, f), deg, f) for n, h in found.items()}
    inside = inside_band(f)
    sd = "random error, 2 sd"
    magnitude = Panel(
        "magnitude, dB",
        f.w,
        (Curve("measured", db, DATA, width=2.0), *_drawn(models_db, models)),
        (Spread(sd, db + 20 * np.log10(1 - error), db + 20 * np.log10(1 + error)),),
        limits_around([db[inside], *(y[inside] for y in models_db.values())], 20),
        height=170,
    )
    phase = Panel(
        "phase, deg",
        f.w,
        (Curve("measured", deg, DATA, width=2.0, dots=not f.band), *_drawn(models_deg, models)),
        (Spread(sd, deg - spread, deg + spread),) if f.band else (),
        limits_around([deg[inside], *(y[inside] for y in models_deg.values())], 100),
        height=140,
    )
    name = "partial coherence" if f.conditioned_on else "coherence"
    coherence = Panel(
        name, f.w, (Curve(name, f.coherence, DATA),), limits=(0.0, 1.04), levels=(COHERENCE_GOOD,), height=80
    )
    return Stack(
        _title(f, group, models, units),
        "frequency, rad/s",
        (magnitude, phase, coherence),
        _span(f),
        "log",
        *_band(f),
    )


def _drawn(lines: Mapping[str, Array], models: Models) -> list[Curve]:
    return [Curve(f"{n} model", y, **model_colours(n, models)) for n, y in lines.items()]


def _span(f: FrequencyResponse) -> tuple[float, float]:
    return 0.93 * float(f.w[0]), 1.07 * float(f.w[-1])


def _band(f: FrequencyResponse) -> tuple[tuple[tuple[float, float, str], ...], tuple[tuple[float, str], ...]]:
    """(shades outside of the usable band, marks at its ends)."""
    low, high = f.band or (f.w[-1], f.w[-1])
    return ((1e-3, low, OUTSIDE), (high, 1e4, OUTSIDE)), ((low, MARK), (high, MARK)) if f.band else ()


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
    title = f"{RESPONSE_WORDS[f.output]} / steering"
    return Stack(title, "frequency, rad/s", (panel,), (0.97 * low, 1.03 * high), "log")


def _title(f: FrequencyResponse, group: Group, models: Models, units: ShownUnits) -> str:
    """The response and its unit, and J of each model."""
    without = f" without {', '.join(f.conditioned_on)}" if f.conditioned_on else ""
    what = f"{RESPONSE_WORDS[f.output]} / steering{without}, {units.words(f.unit.replace('^2', '²'))}"
    if not f.band:
        return f"{what}: no usable band"
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
