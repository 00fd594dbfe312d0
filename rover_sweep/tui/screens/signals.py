"""The signals of a run: value, position between limits, short history."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from firmware_params.applet_parameters import PARAMETERS
from rover_sweep.tui.drawn.drawing import ScreenRows
from rover_sweep.tui.drawn.gauges import column_chart, fixed_width, pointer
from rover_sweep.tui.model.setup import Setup
from rover_sweep.tui.model.state import State

_DEFAULTS = {p.name: p.default for p in PARAMETERS}
_STEERED = range(3, 9)  # states of the applet in which the limits apply
_TRIM = 1500.0  # us, without a vehicle file
_AY = 10.0  # m/s^2, range of the gauge; there is no limit
_DEGREES = 180 / math.pi


@dataclass(frozen=True)
class GaugeSignal:
    """field: of a Snapshot, shown in unit after multiplication by scale; low, high: range of the gauge;
    limits: as text, or ''."""

    name: str
    field: str
    scale: float
    unit: str
    form: str
    low: float
    high: float
    limits: str = ""


def limit_of(state: State, setup: Setup) -> Callable[[str], float]:
    """A function for the limits of the applet: set on the vehicle, else on the command line, else default."""
    extra = {f"SWP_{name.upper()}": value for name, value in setup.settings.extra.items()}
    return lambda name: state.parameters.get(name, extra.get(name, _DEFAULTS[name]))


def signals_of(state: State, setup: Setup) -> tuple[GaugeSignal, ...]:
    """The signals with their limits."""
    limit, vehicle = limit_of(state, setup), setup.vehicle
    trim = vehicle.trim_us.value if vehicle and vehicle.trim_us else _TRIM
    most, r_max, roll = limit("SWP_PWM_MAX"), limit("SWP_R_MAX"), limit("SWP_ROLL_MAX")
    slow, fast = limit("SWP_V_MIN"), limit("SWP_V_MAX")
    return (
        GaugeSignal("steering", "pwm", 1.0, "us", "6.0f", trim - most, trim + most, f"{trim:g} ±{most:g}"),
        GaugeSignal("yaw rate", "r", _DEGREES, "°/s", "+6.0f", -r_max, r_max, f"±{r_max:g}"),
        GaugeSignal("lat. acc.", "ay", 1.0, "m/s²", "+6.1f", -_AY, _AY),
        GaugeSignal("speed", "speed", 1.0, "m/s", "6.2f", slow, fast, f"{slow:g} to {fast:g}"),
        GaugeSignal("roll", "phi", _DEGREES, "°", "+6.1f", -roll, roll, f"±{roll:g}"),
    )


def draw_signals(rows: ScreenRows, state: State, setup: Setup, each: int) -> None:
    """Draw the signals, `each` rows per signal."""
    place = 51 if rows.width >= 120 else 21
    _heading(rows, state, place)
    for signal in signals_of(state, setup):
        values = [signal.scale * getattr(one, signal.field) for one in state.history]
        value = values[-1] if values else math.nan
        past = bool(signal.limits) and state.applet in _STEERED and not signal.low <= value <= signal.high
        ink = rows.palette.bad if past else rows.palette.ink
        limits = f"PAST {signal.limits}" if past else signal.limits
        text = f" {signal.name:<9} {fixed_width(value, signal.form)} {signal.unit:<5}"
        where = f"{pointer(value, signal.low, signal.high, place)} {limits:<14.14} "
        drawn = column_chart(values, signal.low, signal.high, rows.width - len(text) - len(where) - 1, each)
        for n, row in enumerate(drawn):
            left = text + where if n == each // 2 else " " * len(text + where)
            rows.add((left, f"bold {ink}" if n == each // 2 else ""), (row, rows.palette.quiet))
        if each > 1:
            rows.blank()


def _heading(rows: ScreenRows, state: State, place: int) -> None:
    """What the columns show: value, place between the limits, and the time that the history spans."""
    columns = rows.width - 23 - place - 17
    past = state.history[-columns:] if columns > 0 else ()
    span = f"last {past[-1].t - past[0].t:.0f} s" if len(past) > 1 else ""
    ends = f"{'low':<{place // 2}}{'high':>{place - place // 2}}"
    rows.add(f" {'':<22}{ends} {'limits':<14} {span:>{max(columns, 0)}}", style=rows.palette.quiet)
