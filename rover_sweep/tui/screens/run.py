"""The current run: the pilot's task, the rover's signals, and how to abort."""

from __future__ import annotations

import math

from rich.text import Text
from textual.binding import Binding

from rover_sweep.live.source import CoherenceBand, Verdict
from rover_sweep.manoeuvre.sweep import Doublet
from rover_sweep.tui import drawn as labels
from rover_sweep.tui.drawn import ScreenRows, bar, big, cells, fixed_width, huge
from rover_sweep.tui.model.plan_rows import task
from rover_sweep.tui.model.state import RunRecord
from rover_sweep.tui.screens.frame import ABORT_WORDS, SessionScreen
from rover_sweep.tui.screens.results import draw_bode, draw_signals

PLAYING = "SPACE pauses, , and . jump 10 s, + and - change the speed."
WAY_OUT = (
    "SPACE or ESC ends a run; without this laptop: switch low, disarm or change the mode. Without this "
    "program's messages, a rover that it drives goes to HOLD."
)


class RunScreen(SessionScreen):
    """G drives the next row of the plan; SPACE and ESC end the run at once."""

    view = "run"
    BINDINGS = [Binding("g", "go", "drive the next")]

    def picture(self, width: int, height: int) -> Text:
        rows = ScreenRows(self.palette, width, height)
        self._title(rows)
        self._to_do(rows)
        self._progress(rows)
        each = max(1, min(6, (height - 28) // 5)) if height > 34 else 1
        draw_signals(rows, self.state, self.session.setup, each)
        rows.blank()
        self._facts(rows)
        abort = 7 if height > 40 else 5 if height > 30 else 3
        rows.down_to(height - abort)
        self._abort(rows, abort)
        return rows.text()

    def _title(self, rows: ScreenRows) -> None:
        state, palette = self.state, self.palette
        run = state.run
        if state.played is None and (state.driving is None or run is None):
            row = self.session.next_row
            following = (
                f"next: {labels.manoeuvre(row.manoeuvre)} at {row.speed:g} m/s"
                if row
                else "the plan is complete"
            )
            waits = run and run.outcome == "done" and run.verdict is None and not run.reason
            verdict = ", computing its verdict" if waits else ""
            last = f"{run.name} {labels.OUTCOMES[run.outcome][1]}{verdict}; " if run else ""
            rows.add(f" {last}{following}", style=f"bold {palette.ink}")
            return
        if run is None:
            rows.blank()
            return
        speed = self.session.driving_speed
        at = f" at {speed:g} m/s" if math.isfinite(speed) else ""
        lasts = labels.seconds(run.manoeuvre.duration)
        rows.add(f" {run.name}: {labels.manoeuvre(run.manoeuvre)}{at}, {lasts}", style=f"bold {palette.ink}")

    def _to_do(self, rows: ScreenRows) -> None:
        now = task(self.state, self.session.driving_speed)
        palette = self.palette
        style = palette.asking if now.urgent else f"bold {palette.accent}"
        if now.big:
            for line in (huge if rows.height > 40 and rows.width >= 150 else big)(now.big):
                rows.filled(f"  {line}", style)
        words = f"{now.big + ': ' if now.big else ''}{now.sentence}"
        rows.sentence(words, f"bold {palette.ink}", most=2, below=12)
        if not now.big:
            rows.blank(3)

    def _progress(self, rows: ScreenRows) -> None:
        state, now = self.state, self.state.snapshot
        progress = now.progress if now else math.nan
        run = state.run
        left = ""
        if run is not None and math.isfinite(progress) and state.driving is not None:
            left = f"{labels.seconds((1 - progress) * run.manoeuvre.duration)} left"
        what = labels.APPLET.get(state.applet, f"state {state.applet}")
        if run is not None and run.manoeuvre.kind == "throttle":
            what = what.replace("steers", "sweeps the throttle")
        width = max(10, rows.width - 64)
        frequency = fixed_width(now.frequency if now else math.nan, "5.1f")
        tone = "" if run is not None and isinstance(run.manoeuvre, Doublet) else f"{frequency} rad/s"
        rows.add(
            f" applet {what:<19.19} {bar(progress, width)} {fixed_width(100 * progress, '3.0f')} %  "
            f"{tone:<12} {left}",
            style=self.palette.ink,
        )

    def _facts(self, rows: ScreenRows) -> None:
        now = self.state.snapshot
        if now is None:
            rows.sentence("No message from the rover yet.", self.palette.quiet)
            return
        armed = "ARMED" if now.armed else "disarmed"
        heard = f"{now.received:.0f} messages/s, " if math.isfinite(now.received) else ""
        before = "last heard: " if self.state.lost else ""
        rows.add(
            f" {before}{armed}, {labels.mode_label(now.mode)}, switch {labels.switch_label(now.switch)}, "
            f"{heard}recorded {labels.size(now.recorded)}",
            style=self.palette.ink,
        )
        if now.link and not self.state.lost:
            rows.sentence(now.link, self.palette.bad, most=2)

    def _abort(self, rows: ScreenRows, height: int) -> None:
        palette = self.palette
        if not self.state.under_way:
            if height > 3:
                rows.blank(height - 3)
            played = self.state.played is not None
            rows.blank(1).sentence(PLAYING if played else WAY_OUT, palette.quiet, most=2)
            return
        words = f"{ABORT_WORDS}: ends the run at once"
        picture = [f"  {line}   " for line in (huge if height > 5 else big)("ABORT")]
        picture[len(picture) // 2] += words
        for line in ["", *picture, ""] if height > 3 else picture:
            rows.filled(line, palette.alarming)


# The verdict on a run: keep or repeat, coherence by band, proposed amplitudes.


_NONE = "This run has no verdict."
NOT_FITTED = "Weak bands of vydot do not count: the models are not fitted to it."
_WAITING = {
    "asked": "The run has not started.",
    "running": "The run is in progress; the verdict follows right after it.",
    "done": "Computing the verdict.",
}


class VerdictScreen(SessionScreen):
    """W adds a repeat with the proposed amplitude to the plan, T lowers the throttle; B draws responses."""

    view = "verdict"
    repeats_messages = False
    BINDINGS = [
        Binding("g", "go", "drive the next"),
        Binding("w", "take", "plan the repeat"),
        Binding("t", "lower", "lower the throttle"),
        Binding("b", "bode", "Bode"),
        Binding("up", "other(-1)", "other response"),
        Binding("down", "other(1)", "other response"),
        Binding("left", "turn(-1)", "other run"),
        Binding("right", "turn(1)", "other run"),
    ]
    back = 0  # index of the shown run, counted back from the latest
    drawn = False  # the response, in place of the tables
    response = 0  # index of the drawn one
    _known = 0  # number of runs when the view was last shown

    def on_screen_resume(self) -> None:
        """Show the latest run if there is a new one."""
        if len(self.state.runs) != self._known:
            self.back, self._known = 0, len(self.state.runs)
        super().on_screen_resume()

    @property
    def run_shown(self) -> RunRecord | None:
        runs = self.state.runs
        return runs[max(0, len(runs) - 1 - self.back)] if runs else None

    def picture(self, width: int, height: int) -> Text:
        rows, palette = ScreenRows(self.palette, width, height), self.palette
        run = self.run_shown
        if run is None:
            return rows.blank().sentence("No run was driven yet.", palette.ink).text()
        sign, outcome = labels.OUTCOMES[run.outcome]
        rows.add(
            f" {run.label}: {labels.manoeuvre(run.manoeuvre)}: {sign} {outcome}", style=f"bold {palette.ink}"
        )
        now = task(self.state)
        if now.urgent and self.state.played is None:  # the verdict comes while the switch is still high
            rows.filled(f" {now.big}: {now.sentence}", palette.asking)
        if run.reason:
            rows.sentence(run.reason, f"bold {palette.bad}", most=2, below=9 + _table(run.verdict))
        if run.verdict is None:
            return rows.blank().sentence(_WAITING.get(run.outcome, _NONE), palette.ink).text()
        if self.drawn and run.verdict.curves:
            draw_bode(rows, run.verdict.curves[self.response % len(run.verdict.curves)])
            return rows.text()
        self._advice(rows, run.verdict)
        rows.sentence(self._next(run), f"bold {palette.accent}", most=2, below=_table(run.verdict))
        if rows.left > 2 and (run.verdict.bands or run.verdict.per_band):
            _matrix(rows.blank(), run.verdict)
            if words := why_kept(run.verdict):
                rows.sentence(words, palette.quiet, most=1)
        return rows.text()

    def _next(self, run: RunRecord) -> str:
        """Sentence on the next step."""
        if self.state.played is not None or self.state.under_way:
            return ""
        verdict, row = run.verdict, self.session.next_row
        again = f"W plans a repeat with {verdict.amplitude:.0f} us. " if verdict and verdict.amplitude else ""
        if verdict is not None and verdict.throttle and self.session.can_lower_throttle(run):
            again = f"T lowers the throttle to {verdict.throttle[1]} us; then G asks and drives it again. "
        if verdict is not None and verdict.advice != "keep" and again:
            return again
        if row is None:
            first = "disarm, then " if self.state.armed else ""
            return f"{again}The plan is complete: {first}6 fetches the logs, 7 identifies, 3 plans more."
        us = self.session.setup.settings.throttle_us
        throttle = "" if us is None else f" with throttle {us} us"
        what = f"{row.name}, {labels.manoeuvre(row.manoeuvre)} at {row.speed:g} m/s"
        return f"{again}Next: {what}{throttle} (G drives it)."

    def _advice(self, rows: ScreenRows, verdict: Verdict) -> None:
        palette = self.palette
        style = {"keep": palette.good, "repeat": palette.doubtful}.get(verdict.advice, palette.bad)
        sign, word = labels.ADVICE[verdict.advice]
        for line in huge(word) if rows.height > 40 else big(word):
            rows.filled(f"  {line}", f"bold {palette.ground} on {style}")
        below = _table(verdict) + 2  # and the next step
        rows.sentence(f"{sign} {verdict_sentence(verdict)}", f"bold {palette.ink}", most=3, below=below)
        in_table = {f"{band.response}: " for band in verdict.bands}
        remarks = [text for text in verdict.remarks if not text.startswith(tuple(in_table))]
        for remark in remarks[: 2 if rows.height < 30 else 6]:
            rows.sentence(remark, palette.ink, most=2, below=below)

    def action_turn(self, step: int) -> None:
        self.back = min(max(0, self.back - step), max(0, len(self.state.runs) - 1))
        self.redraw()

    def action_bode(self) -> None:
        self.drawn = not self.drawn
        self.redraw()

    def action_other(self, step: int) -> None:
        self.response += step
        self.redraw()

    def action_take(self) -> None:
        if self.run_shown is not None:
            self.session.plan_repeat(self.run_shown)

    def action_lower(self) -> None:
        if self.run_shown is not None:
            self.session.lower_throttle(self.run_shown)

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        if action == "lower":
            return self.session.can_lower_throttle(self.run_shown)
        if action == "take":
            return self.run_shown is not None and self.run_shown.verdict is not None
        if action in ("bode", "other"):
            run = self.run_shown
            there = run is not None and run.verdict is not None and bool(run.verdict.curves)
            return there and (action == "bode" or self.drawn)
        if action == "turn":
            return len(self.state.runs) > 1
        return super().check_action(action, parameters)


def verdict_sentence(verdict: Verdict) -> str:
    """The verdict's sentence, starting with the advice in capitals."""
    word, sentence = labels.ADVICE[verdict.advice][1], verdict.sentence
    if sentence.lower().startswith(word.lower()):
        return word + sentence[len(word) :]
    return f"{word}: {sentence}"


def why_kept(verdict: Verdict) -> str:
    """Why weak bands of V_y do not count in a run that is kept; "" where there are none."""
    weak = {band.response for band in verdict.bands if band.coherence < 0.6}
    return NOT_FITTED if verdict.advice == "keep" and weak == {"vydot"} else ""


def _table(verdict: Verdict | None) -> int:
    """Rows of the table of a verdict, with its heading and the text around it."""
    if verdict is None or not (verdict.bands or verdict.per_band):
        return 0
    return len(_spans(verdict)) + 2 + bool(why_kept(verdict))


def _spans(verdict: Verdict) -> list[tuple[float, float]]:
    """(low, high) of each row of the table, rad/s."""
    return sorted(
        {(b.low, b.high) for b in verdict.bands} | {(low, high) for low, high, _ in verdict.per_band}
    )


def _matrix(rows: ScreenRows, verdict: Verdict) -> None:
    """A row per band, a column per response, and the amplitude [us] needed in the band."""
    responses = tuple(dict.fromkeys(band.response for band in verdict.bands))
    spans = _spans(verdict)
    there = {(band.response, band.low, band.high): band for band in verdict.bands}
    wanted = {(low, high): us for low, high, us in verdict.per_band}
    wide = rows.width >= 110
    widths = (13, *((24 if wide else 13) for _ in responses), 9)
    names = (labels.RESPONSES.get(response, response) for response in responses)
    rows.add(" " + cells(("rad/s", *names, "us needed"), widths), style=rows.palette.quiet)
    for low, high in spans[: rows.left - (len(spans) > rows.left)]:
        coherences = (_coherence(there.get((response, low, high)), wide) for response in responses)
        us = f"{wanted[low, high]:.0f}" if (low, high) in wanted else ""
        rows.add(" " + cells((f"{low:.2g} to {high:.2g}", *coherences, us), widths), style=rows.palette.ink)
    if rows.left == 1 and len(spans) > 1:
        rows.add(" ... more rows in a larger window", style=rows.palette.quiet)


def _coherence(band: CoherenceBand | None, wide: bool) -> str:
    if band is None:
        return "-"
    word = band.words.partition(":")[0]
    return f"{bar(band.coherence, 6)} {fixed_width(band.coherence, '.2f')} {word}" if wide else word
