"""The plan: runs with amplitude and speed, space and time needed, outcome, and proposed runs."""

from __future__ import annotations

import math
from dataclasses import replace

from rich.text import Text
from textual.binding import Binding

from rover_sweep.live.source import Connect, Fix, Preflight
from rover_sweep.tui import drawn as labels
from rover_sweep.tui.drawn import Palette, Question, ScreenRows, cells, moved, window, wrapped
from rover_sweep.tui.model.plan_rows import SPEED, Row, largest, needs, new
from rover_sweep.tui.model.setup import driven_for
from rover_sweep.tui.model.state import RunRecord
from rover_sweep.tui.screens.edit import EditRow
from rover_sweep.tui.screens.frame import SessionScreen
from rover_sweep.vehicle.preflight.read_rover import Check


class PlanScreen(SessionScreen):
    """A, D, M, B add rows on the steering, H one on the throttle; E changes, G drives one; P proposes rows.

    P runs `rover-sweep plan`; T adds its rows.
    N adds the run that best settles the open effects of a diagnosis of the runs.
    """

    view = "plan"
    BINDINGS = [
        Binding("g", "go", "drive"),
        Binding("up", "choose(-1)", "choose"),
        Binding("down", "choose(1)", "choose"),
        Binding("e", "edit", "change"),
        Binding("a", "add('sweep')", "sweep"),
        Binding("d", "add('doublet')", "doublet"),
        Binding("m", "add('multisine')", "multisine"),
        Binding("b", "add('bias_sweep')", "bias"),
        Binding("h", "add('throttle')", "throttle"),
        Binding("x", "remove", "remove"),
        Binding("p", "propose", "propose"),
        Binding("t", "take", "take"),
        Binding("n", "choose_next", "next step"),
    ]

    @property
    def chosen(self) -> int:
        """Index of the row to drive next; the number of rows if all are driven."""
        return self.session.chosen

    def picture(self, width: int, height: int) -> Text:
        rows, palette, session = ScreenRows(self.palette, width, height), self.palette, self.session
        plan = session.plan
        asked = needs(plan, session.setup.vehicle)
        wide = width >= 110
        sizes = (
            (1, 12, -8, -4, 11, -4, 9, width - 56) if not wide else (2, 16, -10, -8, 18, -8, 16, width - 85)
        )
        rows.add(cells(("", "run", "us", "m/s", "rad/s", "s", "space", "driven"), sizes), style=palette.quiet)
        analyses = session.analyses
        room = max(
            3, height - 7 - (4 if analyses.proposal or analyses.proposing or analyses.next_step else 0)
        )
        for n in window(len(plan), self.chosen, room):
            row, space, m = plan[n], asked.spaces[n], plan[n].manoeuvre
            ground = f"{space.length:.0f}x{space.width:.0f} m" if space else "?"
            line = cells(
                (
                    "▶" if n == self.chosen else "",
                    row.name,
                    _amplitude(row),
                    f"{row.speed:.1f}",
                    f"{m.count} x {m.pulse:g} s" if m.kind == "doublet" else f"{m.w_min:g} to {m.w_max:g}",
                    f"{row.manoeuvre.duration:.0f}",
                    ground,
                    last_outcome(row, self.state.runs),
                ),
                sizes,
            )
            rows.listed(line, n == self.chosen)
        if not plan:
            rows.sentence("The plan is empty: A adds a sweep, D a doublet, P proposes runs.", palette.ink)
        rows.blank()
        self._sums(rows)
        if plan and plan[min(self.chosen, len(plan) - 1)].settles:
            rows.sentence(plan[min(self.chosen, len(plan) - 1)].settles, palette.ink, most=2, below=8)
        self._proposal(rows)
        return rows.text()

    def _sums(self, rows: ScreenRows) -> None:
        palette, session = self.palette, self.session
        asked = needs(session.plan, session.setup.vehicle)
        length, width = largest(asked.spaces)
        ground = asked.words or f"space {length:.0f} x {width:.0f} m"
        if not math.isfinite(length) and not asked.words:
            ground = "no space is needed"
        now = self.state.snapshot
        battery = f"; battery {100 * now.remaining:.0f} %" if now and math.isfinite(now.remaining) else ""
        if now and not battery and math.isfinite(now.volts):
            battery = f"; battery {now.volts:.1f} V"
        what = " and throttle" if any(row.kind == "throttle" for row in session.plan) else ""
        rows.sentence(
            f"{len(session.plan)} runs, {labels.seconds(asked.seconds)} of steering{what}; {ground}{battery}",
            f"bold {palette.ink}",
            most=2,
        )

    def _proposal(self, rows: ScreenRows) -> None:
        palette, session = self.palette, self.session
        if session.analyses.proposing:
            rows.sentence(f"Proposal of further runs: {session.analyses.proposing}", palette.accent, most=2)
        elif session.analyses.proposal:
            proposal = session.analyses.proposal
            runs = ", ".join(
                f"{f'{n} x ' if (n := proposal.count(row)) > 1 else ''}{row.kind} {_amplitude(row)} us at "
                f"{row.speed:g} m/s"
                for row in dict.fromkeys(proposal)
            )
            rows.sentence(f"PROPOSED (T adds them): {runs}", f"bold {palette.accent}", most=3, below=6)
            for settles in dict.fromkeys(row.settles for row in proposal if row.settles):
                rows.sentence(settles, palette.accent, most=2, below=4)
        if session.analyses.next_step:
            rows.sentence(f"Next step: {session.analyses.next_step}", palette.accent, most=4, below=2)
        for sentence in session.analyses.next_runs[:2]:
            rows.sentence(f"The diagnosis proposes: {sentence}", palette.accent, most=2, below=2)

    def action_choose(self, step: int) -> None:
        past = self.chosen >= len(self.session.plan)
        self.session.choose(0 if past and step > 0 else self.chosen + step)

    def action_add(self, kind: str) -> None:
        plan = self.session.plan
        speed = plan[min(self.chosen, len(plan) - 1)].speed if plan else SPEED
        at = min(self.chosen + 1, len(plan))
        self.session.replan((*plan[:at], new(kind, speed), *plan[at:]), at)

    def action_remove(self) -> None:
        plan, at = self.session.plan, self.chosen
        self.session.replan((*plan[:at], *plan[at + 1 :]), at)

    def action_edit(self) -> None:
        row = self.session.plan[self.chosen]
        self.app.push_screen(EditRow(row, self.session.setup.settings.extra), self._edited)

    def _edited(self, row: Row | None) -> None:
        plan, at = self.session.plan, self.chosen
        if row is not None and at < len(plan):
            self.session.replan((*plan[:at], row, *plan[at + 1 :]), at)

    def action_propose(self) -> None:
        self.session.propose()

    def action_take(self) -> None:
        session = self.session
        rows, session.analyses.proposal = session.analyses.proposal, ()
        session.replan((*session.plan, *(replace(row) for row in rows)), len(session.plan))

    def action_choose_next(self) -> None:
        self.session.choose_next()

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        if action in ("edit", "remove"):
            return self.session.next_row is not None
        if action == "choose":
            return bool(self.session.plan)
        if action == "choose_next":
            return self.session.can_analyse("diagnose") and not self.session.analyses.choosing
        if action == "take":
            return bool(self.session.analyses.proposal)
        if action == "propose":
            return (
                self.session.setup.vehicle_path is not None
                and not self.session.analyses.proposing.startswith("this")
            )
        return super().check_action(action, parameters)


def last_outcome(row: Row, runs: tuple[RunRecord, ...]) -> str:
    """The outcome of a row's latest run, and the number of earlier runs."""
    outcomes = [
        " ".join(labels.ADVICE[run.verdict.advice] if run.verdict else labels.OUTCOMES[run.outcome])
        for run in reversed(driven_for(row, runs))
    ]
    before = f" ({len(outcomes) - 1} before)" if len(outcomes) > 1 else ""
    return f"{outcomes[0]}{before}" if outcomes else ""


def _amplitude(row: Row) -> str:
    m = row.manoeuvre
    bias = getattr(m, "bias", 0.0)
    return f"±{m.amplitude:g}" + (f"{bias:+g}" if bias else "")


# The checks before a run: state, observed value, and the key that fixes it.


_BELOW, _LISTED = 6, 8  # least rows for the text on the chosen check, and for the list if the text is long


class PreflightScreen(SessionScreen):
    """F fixes the chosen check; it asks first if that reboots the rover."""

    view = "preflight"
    BINDINGS = [
        Binding("f", "fix", "fix it"),
        Binding("up", "choose(-1)", "choose"),
        Binding("down", "choose(1)", "choose"),
        Binding("r", "look", "check again"),
    ]
    chosen: int | None = None  # None: the first that is not good

    @property
    def index(self) -> int:
        """Index of the chosen check."""
        checks = self.state.checks
        if self.chosen is not None:
            return min(self.chosen, len(checks) - 1)
        worst = (n for state in ("bad", "doubtful") for n, check in enumerate(checks) if check.state == state)
        return next(worst, 0)

    @property
    def check(self) -> Check | None:
        checks = self.state.checks
        return checks[self.index] if checks else None

    def picture(self, width: int, height: int) -> Text:
        rows, palette = ScreenRows(self.palette, width, height), self.palette
        checks, chosen = self.state.checks, self.index
        name = 12 if width < 110 else 20
        about = _about(self.check, palette, width, width - name - 18) if self.check else []
        below = max(_BELOW, min(1 + len(about), height - 2 - min(len(checks), _LISTED)))
        shown = window(len(checks), chosen, height - 2 - below)
        hidden = f"; {len(checks) - len(shown)} more, ↑ ↓" if len(shown) < len(checks) else ""
        checking = any(isinstance(request, Connect | Fix | Preflight) for request in self.state.asked)
        old = bool(checks) and (checking or self.session.checks_old)
        counted = count_line(checks, labels.ago(self.session.checks_age))
        if checking:
            counted = "Checking again; the results below are from before" if old else "Checking"
        rows.add(f" {counted}{hidden}", style=f"bold {palette.ink}")
        for n in shown:
            check = checks[n]
            sign, word = labels.CHECKS[check.state]
            line = cells(
                (f"{sign} {word}", check.name.replace("_", " "), check.seen), (11, name, width - name - 18)
            )
            line = f" {'▶' if n == chosen else ' '} {line}"
            if n == chosen:
                rows.filled(line, palette.inverse)
            else:
                colour = {"good": palette.good, "doubtful": palette.doubtful, "bad": palette.bad}
                first = f"bold {colour.get(check.state, palette.ink)}"
                rows.add(
                    (line[:14], palette.quiet if old else first),
                    (line[14:], palette.quiet if old else palette.ink),
                )
        rows.down_to(height - below)
        if about:
            rows.add("─" * width, style=palette.quiet)
        for n, (text, style) in enumerate(about[: rows.left]):
            cut = " …" if n + 1 < len(about) and rows.left == 1 else ""
            rows.add((f" {text}{cut}", style))
        return rows.text()

    def action_choose(self, step: int) -> None:
        if count := len(self.state.checks):
            self.chosen = moved(self.index, step, count)
            self.redraw()

    def action_look(self) -> None:
        self.chosen = None
        self.session.ask(Preflight())

    def action_fix(self) -> None:
        check = self.check
        if check is None or check.remedy is None or check.remedy.by_hand:
            return
        if not check.remedy.reboot:
            self._fix(Fix(check.name))
            return
        question = f"{check.remedy.words}\n\nThis reboots the rover. It must stand still and be disarmed."

        def answer(yes: bool | None) -> None:
            if yes:
                self._fix(Fix(check.name, reboot=True))

        self.app.push_screen(Question(question, "fix it and reboot the rover"), answer)

    def _fix(self, request: Fix) -> None:
        self.chosen = None  # then the next that is not good
        self.session.ask(request)

    def why_not(self, action: str) -> str:
        if (why := super().why_not(action)) or action != "fix" or self.check is None:
            return why
        if self.check.remedy is None:
            return f"there is nothing to fix at {self.check.name.replace('_', ' ')}"
        return "this is done by hand, as described above"

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        if action == "fix":
            remedy = self.check.remedy if self.check else None
            return remedy is not None and not remedy.by_hand and not self.state.busy
        return action != "look" or (self.state.vehicle is not None and not self.state.busy)


def count_line(checks: tuple[Check, ...], ago: str = "") -> str:
    """Sentence with the number of checks in each state. ago: when that was, "" for now."""
    if not checks:
        return "Not checked yet. In view 1, ENTER connects and runs the checks."
    bad = sum(check.state == "bad" for check in checks)
    other = sum(check.state in ("doubtful", "unknown") for check in checks)
    if not bad and not other:
        if ago:
            return f"All {len(checks)} checks were good {ago}; R checks again, 3 plans the runs"
        return f"All {len(checks)} checks are good: press 3 to plan the runs"
    again = f", {ago}: R checks again" if ago else ""
    return f"{bad} bad, {other} doubtful or unknown, {len(checks) - bad - other} good{again}"


def _about(check: Check, palette: Palette, width: int, column: int) -> list[tuple[str, str]]:
    """(row, style) of the text on a check: what was found, if it is cut in its `column`; why; the remedy."""
    seen = f"{check.name.replace('_', ' ')}: {check.seen}"
    found = check.sentence if len(check.seen) <= column else f"{seen}. {check.sentence}"
    parts = [(found or seen, palette.ink)]
    if check.remedy is not None and check.remedy.by_hand:
        parts.append((f"BY HAND: {check.remedy.words}", f"bold {palette.accent}"))
    elif check.remedy is not None:
        after = " (reboots the rover; asks first)" if check.remedy.reboot else ""
        parts.append((f"F: {check.remedy.words}{after}", f"bold {palette.accent}"))
    return [(row, style) for text, style in parts for row in wrapped(text, width - 2)]
