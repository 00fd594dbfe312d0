"""Identify, diagnose and gains with their reports, computed in the background while runs are driven."""

from __future__ import annotations

import math
import shlex
from collections.abc import Sequence
from dataclasses import dataclass

from rich.text import Text
from textual.binding import Binding

from rover_sweep.data.braille import braille_lines, ruler
from rover_sweep.live.players import STEERED
from rover_sweep.live.source import ResponseCurve
from rover_sweep.manoeuvre.sweep import DEFAULTS
from rover_sweep.tui import drawn as labels
from rover_sweep.tui.drawn import (
    Palette,
    ScreenRows,
    column_chart,
    cut_line,
    fixed_width,
    moved,
    pointer,
    window,
    wrapped,
)
from rover_sweep.tui.jobs import AnalysisJob
from rover_sweep.tui.model.setup import Setup
from rover_sweep.tui.model.state import State
from rover_sweep.tui.screens.frame import SessionScreen

_SIGNS = {"running": "▶ working", "done": "✓ done", "failed": "✗ failed"}


class ResultsScreen(SessionScreen):
    """Each key starts the command of that name in a separate process; the session continues."""

    view = "results"
    BINDINGS = [
        Binding("i", "start('identify')", "identify"),
        Binding("d", "start('diagnose')", "diagnose"),
        Binding("s", "start('gains')", "gains"),
        Binding("o", "open", "open the report"),
        Binding("k", "stop", "stop it"),
        Binding("up", "choose(-1)", "choose"),
        Binding("down", "choose(1)", "choose"),
        Binding("pageup", "page(-1)", "more"),
        Binding("pagedown", "page(1)", "more"),
    ]
    chosen: int | None = None  # None: the latest
    down = 0  # rows scrolled down
    _last = 0  # largest value of down

    @property
    def jobs(self) -> tuple[AnalysisJob, ...]:
        return self.session.analyses.jobs

    @property
    def job(self) -> AnalysisJob | None:
        return self.jobs[self.index] if self.jobs else None

    @property
    def index(self) -> int:
        """Index of the chosen job."""
        latest = len(self.jobs) - 1
        return latest if self.chosen is None else min(self.chosen, latest)

    def picture(self, width: int, height: int) -> Text:
        rows, palette = ScreenRows(self.palette, width, height), self.palette
        rows.sentence(self._from(), palette.ink, most=2)
        for n in window(len(self.jobs), self.index, 4):
            job = self.jobs[n]
            mark = "▶" if job is self.job and len(self.jobs) > 1 else " "
            took = labels.seconds(job.seconds) if job.seconds else "earlier"
            text = job.summary[0] if job.summary else job.last
            line = cut_line(f" {mark} {_SIGNS[job.outcome]:<10} {job.kind:<10} {took:>10}  {text}", width)
            rows.listed(line, n == self.index)
        if self.job is not None:
            self._about(rows, self.job)
        return rows.text()

    def _from(self) -> str:
        """Sentence on the runs that can be analysed, or on what is missing."""
        if self.state.played is not None:
            given = shlex.quote(self.state.url)
            return f"Identify this recording with: rover-sweep identify {given} --out report"
        whole = [run.label for run in self.state.runs if run.outcome == "done"]
        if not whole:
            return "No complete run yet: nothing to identify."
        if self.session.setup.vehicle_path is None:
            return "No vehicle file: quit and start again with --vehicle rover.toml to identify here."
        report = self.session.analyses.report(self.job)
        gains = f"S computes gains from {report.name}" if report else ""
        if self.state.logs:
            more = f"; {gains}" if gains else ""
        else:
            then = f", then {gains}" if gains else ""
            more = f" (from telemetry; press 6 and L to fetch the log{then})"
        return f"I identifies, D diagnoses {', '.join(whole)}{more}"

    def _about(self, rows: ScreenRows, job: AnalysisJob) -> None:
        palette = self.palette
        rows.blank()
        if job.page is not None:
            rows.sentence(f"report: {job.page} (O opens it)", f"bold {palette.accent}", most=2)
        lines = _result_lines(job, palette, rows.width - 2)
        room = max(1, rows.left - 1)
        self._last = max(0, len(lines) - room)
        at = self._last if job.outcome == "running" else min(self.down, self._last)
        for row, style in lines[at : at + room]:
            rows.add((f" {row}", style))
        if at < self._last:
            more = len(lines) - at - room
            rows.add(f" ... {more} more row{'s' * (more > 1)} (PGDN)", style=palette.quiet)

    def action_page(self, step: int) -> None:
        self.down = min(max(0, self.down + 8 * step), self._last)
        self.redraw()

    def action_start(self, kind: str) -> None:
        self.session.analyse(kind, self.job)
        self.chosen, self.down = None, 0
        self.redraw()

    def action_open(self) -> None:
        if self.job is not None and self.job.page is not None:
            self.session.open_page(self.job.page)

    def action_stop(self) -> None:
        if self.job is not None:
            self.session.analyses.stop(self.job)

    def action_choose(self, step: int) -> None:
        self.chosen, self.down = moved(self.index, step, len(self.jobs)), 0
        self.redraw()

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        if action == "start":
            return self.session.can_analyse(str(parameters[0]))
        if action == "open":
            return self.job is not None and self.job.page is not None
        if action == "stop":
            return self.job is not None and self.job.outcome == "running"
        if action == "page":
            return self._last > 0
        return action != "choose" or len(self.jobs) > 1


def _result_lines(job: AnalysisJob, palette: Palette, width: int) -> list[tuple[str, str]]:
    """(row, style) of the summary, its first sentence bold; without a summary, of the output."""
    lines = [
        (row, f"bold {palette.ink}" if n == 0 else palette.ink)
        for n, text in enumerate(job.summary)
        for row in wrapped(text, width)
    ]
    if job.summary:
        return lines
    ink = palette.bad if job.outcome == "failed" else palette.ink
    printed = [line.rstrip() for line in job.lines]
    return [(row, ink) for line in printed for row in (wrapped(line, width) if len(line) > width else [line])]


# The frequency response of a run just driven: gain, phase and coherence over frequency.


ENOUGH = 0.6  # coherence from which a point is used in a fit
_LABELS = 13  # columns
_INPUTS = {
    "rad": "rad of wheel angle, left positive, as in the report",
    "us": "us of output (report: per rad, left positive)",
}


def draw_bode(rows: ScreenRows, curve: ResponseCurve) -> None:
    """Three panels over one frequency axis, in the rows that are left."""
    palette = rows.palette
    name = labels.RESPONSES.get(curve.response, curve.response)
    rows.add(f" {name} per {_INPUTS[curve.steering]}, over rad/s", style=f"bold {palette.ink}")
    room, width = rows.left - 2, rows.width - _LABELS - 1
    if room < 9 or len(curve.w) < 2:
        rows.add(" too few points, or too small a window, for a picture", style=palette.quiet)
        return
    each = room // 3
    trusted = [k for k, c in enumerate(curve.coherence) if c >= ENOUGH] or range(len(curve.w))
    _panel(rows, "gain dB", curve.w, curve.gain, _range([curve.gain[k] for k in trusted], 5.0), each)
    _panel(rows, "phase deg", curve.w, curve.phase, _range([curve.phase[k] for k in trusted], 90.0), each)
    _panel(rows, "coherence", curve.w, curve.coherence, (0.0, 1.0), room - 2 * each)
    rows.add(" " * _LABELS + decades(curve.w[0], curve.w[-1], width), style=palette.quiet)
    good = sum(c >= ENOUGH for c in curve.coherence) / len(curve.w)
    rows.add(f" coherence is at least {ENOUGH:g} at {100 * good:.0f} % of the points", style=palette.ink)


def _panel(
    rows: ScreenRows, name: str, w: Sequence[float], y: Sequence[float], ends: tuple[float, float], each: int
) -> None:
    across = [math.log(one) for one in w]
    drawn = braille_lines([(across, y)], (across[0], across[-1]), ends, rows.width - _LABELS - 1, each)
    for n, line in enumerate(drawn):
        value = f"{ends[1]:.4g}" if n == 0 else f"{ends[0]:.4g}" if n == each - 1 else ""
        word = name if n == each // 2 else ""
        rows.add(
            (f" {word or value:>{_LABELS - 3}} ┤" if value or word else " " * (_LABELS - 1) + "│", ""),
            (line, rows.palette.accent),
            style=rows.palette.ink,
        )


def _range(values: Sequence[float], step: float) -> tuple[float, float]:
    """The ends, multiples of `step`, of an axis that holds the values."""
    finite = [v for v in values if math.isfinite(v)] or [0.0]
    low, high = math.floor(min(finite) / step) * step, math.ceil(max(finite) / step) * step
    return low, (high if high > low else low + step)


def decades(low: float, high: float, width: int) -> str:
    """A row of `width` characters below a logarithmic axis: the ends, and 1, 2, 5, ... at their places."""
    exponents = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    values = [digit * 10.0**exponent for exponent in exponents for digit in (1, 2, 5)]
    places = [(math.log(v / low) / math.log(high / low), f"{v:g}") for v in values if low < v < high]
    return ruler([(0.0, f"{low:.2g}"), (1.0, f"{high:.2g}"), *places], width)


# The signals of a run: value, position between limits, short history.


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


def signals_of(state: State, setup: Setup) -> tuple[GaugeSignal, ...]:
    """The signals with the limits of the applet."""
    known = DEFAULTS | {f"SWP_{name.upper()}": value for name, value in setup.settings.extra.items()}
    known, vehicle = known | state.parameters, setup.vehicle  # default, command line, set on the vehicle
    trim = vehicle.trim_us.value if vehicle and vehicle.trim_us else _TRIM
    most, r_max, roll, slow, fast = (
        known[f"SWP_{n}"] for n in ("PWM_MAX", "R_MAX", "ROLL_MAX", "V_MIN", "V_MAX")
    )
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
        past = bool(signal.limits) and state.applet in STEERED and not signal.low <= value <= signal.high
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
    """Heading of the columns: value, place between the limits, and duration of the history."""
    columns = rows.width - 23 - place - 17
    past = state.history[-columns:] if columns > 0 else ()
    span = f"last {past[-1].t - past[0].t:.0f} s" if len(past) > 1 else ""
    ends = f"{'low':<{place // 2}}{'high':>{place - place // 2}}"
    rows.add(f" {'':<22}{ends} {'limits':<14} {span:>{max(columns, 0)}}", style=rows.palette.quiet)
