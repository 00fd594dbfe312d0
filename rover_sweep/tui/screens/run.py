"""The run under way: what the pilot has to do, what the rover does, and how it is ended."""

from __future__ import annotations

import math

from rich.text import Text
from textual.binding import Binding

from firmware_params.parameters import PARAMETERS
from rover_sweep.identify.sweep import Doublet
from rover_sweep.tui import words
from rover_sweep.tui.big import big
from rover_sweep.tui.drawing import Rows
from rover_sweep.tui.gauges import bar, history, number, pointer
from rover_sweep.tui.pilot import task
from rover_sweep.tui.screens.base import SessionScreen
from rover_sweep.tui.screens.frame import ABORT_WORDS
from rover_sweep.tui.state import State

_DEFAULTS = {p.name: p.default for p in PARAMETERS}
_STEERED = range(3, 9)  # states of the applet
_TRIM = 1500.0  # us, where no vehicle file says


class RunScreen(SessionScreen):
    """G drives the row of the plan that is next; SPACE and ESC end the run at once."""

    view = "run"
    BINDINGS = [Binding("g", "go", "drive the next")]

    def picture(self, width: int, height: int) -> Text:
        rows = Rows(self.palette, width, height)
        self._title(rows)
        self._to_do(rows)
        self._progress(rows)
        rows.blank(1 + (height > 40))
        self._signals(rows)
        rows.blank(1)
        self._facts(rows)
        abort = 5 if height > 30 else 3
        rows.down_to(height - abort)
        self._abort(rows, abort)
        return rows.text()

    def action_go(self) -> None:
        self.session.drive_next()

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        return action != "go" or self.session.may_drive

    def limit(self, name: str) -> float:
        """A limit of the applet: as it was set on the vehicle, as the command line says, as it comes."""
        extra = self.session.setup.settings.extra
        given = extra.get(name.removeprefix("SWP_").lower(), _DEFAULTS[name])
        return self.state.parameters.get(name, given)

    def _title(self, rows: Rows) -> None:
        state, palette = self.state, self.palette
        run = state.run
        if state.driving is None or run is None:
            row = self.session.next_row
            following = (
                f"next: {words.manoeuvre(row.manoeuvre)} at {row.speed:g} m/s"
                if row
                else "the plan is driven"
            )
            last = f"{run.name} {words.OUTCOMES[run.outcome][1]}; " if run else ""
            rows.add(f" {last}{following}", style=f"bold {palette.ink}")
            return
        rows.add(f" {run.name}: {words.manoeuvre(run.manoeuvre)}, {words.seconds(run.manoeuvre.duration)}",
                 style=f"bold {palette.ink}")  # fmt: skip

    def _to_do(self, rows: Rows) -> None:
        now = task(self.state, self.session.driving_speed)
        palette = self.palette
        style = palette.asking if now.urgent else f"bold {palette.accent}"
        if now.big:
            for line in big(now.big):
                rows.filled(f"  {line}", style)
        rows.sentence(f"{now.big + ': ' if now.big else ''}{now.sentence}", f"bold {palette.ink}", most=2)
        if not now.big:
            rows.blank(3)

    def _progress(self, rows: Rows) -> None:
        state, now = self.state, self.state.snapshot
        progress = now.progress if now else math.nan
        run = state.run
        left = ""
        if run is not None and math.isfinite(progress) and state.driving is not None:
            left = f"{words.seconds((1 - progress) * run.manoeuvre.duration)} left"
        what = words.APPLET.get(state.applet, f"state {state.applet}")
        width = max(10, rows.width - 64)
        frequency = number(now.frequency if now else math.nan, "5.1f")
        tone = "" if run is not None and isinstance(run.manoeuvre, Doublet) else f"{frequency} rad/s"
        rows.add(f" applet {what:<19.19} {bar(progress, width)} {number(100 * progress, '3.0f')} %  "
                 f"{tone:<12} {left}", style=self.palette.ink)  # fmt: skip

    def _signals(self, rows: Rows) -> None:
        """Steering, yaw rate, side acceleration, speed, roll: number, place between limits, short history."""
        vehicle, state = self.session.setup.vehicle, self.state
        trim = vehicle.trim_us.value if vehicle and vehicle.trim_us else _TRIM
        most, r_max = self.limit("SWP_PWM_MAX"), self.limit("SWP_R_MAX")
        slow, fast, roll = self.limit("SWP_V_MIN"), self.limit("SWP_V_MAX"), self.limit("SWP_ROLL_MAX")
        signals = (
            ("steering", "pwm", 1.0, "us", "6.0f", trim - most, trim + most, f"{trim:g} ±{most:g}"),
            ("yaw rate", "r", 180 / math.pi, "°/s", "+6.0f", -r_max, r_max, f"±{r_max:g}"),
            ("side acc.", "ay", 1.0, "m/s²", "+6.1f", -10.0, 10.0, ""),
            ("speed", "speed", 1.0, "m/s", "6.2f", slow, fast, f"{slow:g} to {fast:g}"),
            ("roll", "phi", 180 / math.pi, "°", "+6.1f", -roll, roll, f"±{roll:g}"),
        )
        wide = rows.width >= 120
        place, past = (51, rows.width - 104) if wide else (21, rows.width - 61)
        for name, field, scale, unit, form, low, high, limits in signals:
            values = [scale * getattr(one, field) for one in state.history]
            value = values[-1] if values else math.nan
            off = state.applet in _STEERED and bool(limits) and not low <= value <= high
            style = f"bold {self.palette.bad}" if off else self.palette.ink
            rows.add(
                (f" {name:<9} {number(value, form)} {unit:<5}", f"bold {style.split()[-1]}"),
                (f"{pointer(value, low, high, place)} {'PAST ' + limits if off else limits:<14.14} ", style),
                (history(values, low, high, past), self.palette.quiet),
            )
            if rows.height > 40:
                rows.blank()

    def _facts(self, rows: Rows) -> None:
        now = self.state.snapshot
        if now is None:
            rows.sentence("Nothing was heard of the rover yet.", self.palette.quiet)
            return
        armed = "ARMED" if now.armed else "disarmed"
        rows.add(
            f" {armed}, {words.mode(now.mode)}, switch {words.switch(now.switch)}, "
            f"{number(now.received, '.0f')} messages/s, recorded {words.size(now.recorded)}",
            style=self.palette.ink,
        )

    def _abort(self, rows: Rows, height: int) -> None:
        palette = self.palette
        if not self.state.under_way:
            if height > 3:
                rows.blank(height - 3)
            rows.blank(1).sentence(_way_out(self.state), palette.quiet, most=2)
            return
        said = f"{ABORT_WORDS}: ends the run at once"
        picture = [f"  {line}   " for line in big("ABORT")]
        picture[1] += said
        for line in ["", *picture, ""] if height > 3 else picture:
            rows.filled(line, palette.alarming)


def _way_out(state: State) -> str:
    if state.played is not None:
        return "A recording: nothing moves."
    return "SPACE or ESC end a run; without this laptop the switch low, disarming or another mode do."
