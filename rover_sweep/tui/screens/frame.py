"""The frame of all screens: views, state of the rover, last message, keys."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rich.text import Text

from rover_sweep.live.source import Connect, DriveRequest, FetchLogs, Fix, Play, Preflight, Request
from rover_sweep.tui.drawn import labels
from rover_sweep.tui.drawn.drawing import ScreenRows, cut_line, joined
from rover_sweep.tui.drawn.palette import Palette
from rover_sweep.tui.model.pilot import Task
from rover_sweep.tui.model.state import State

VIEWS = ("connect", "preflight", "plan", "run", "verdict", "log", "results")
LEAST = (72, 20)  # columns, rows
_LONG = 5.0  # s after which the elapsed time of a request is shown
ABORT_WORDS = "SPACE or ESC"
LEVELS = {"info": "", "vehicle": "rover: ", "warning": "WARNING: ", "error": "ERROR: "}


def tabs(view: str, palette: Palette, width: int) -> Text:
    """The views with their digits; the current one in brackets and inverse."""
    text = Text(" ", no_wrap=True)
    for digit, name in enumerate(VIEWS, 1):
        here = name == view
        text.append(
            f"[{digit} {name.upper()}]" if here else f" {digit} {name} ", palette.inverse if here else ""
        )
    text.truncate(width)
    return text


def status(state: State, palette: Palette, width: int) -> Text:
    """Link, arming, mode, switch, battery, GPS and recording in one row."""
    link, style = _link(state, palette)
    now = state.snapshot
    text = Text(f" {link}", style=f"bold {style}", no_wrap=True)
    if now is None:
        return text
    if state.lost:
        text.append("  last heard:", palette.ink)
    armed = ("  ARMED ", palette.alarming) if now.armed else ("  disarmed ", palette.ink)
    text.append(*armed)
    text.append(f" {labels.mode_label(now.mode)}  switch {labels.switch_label(now.switch)}", palette.ink)
    battery = joined(
        (
            f"{now.volts:.1f} V" if math.isfinite(now.volts) else "",
            f"{100 * now.remaining:.0f} %" if math.isfinite(now.remaining) else "",
        )
    )
    gps = f"{labels.FIXES.get(now.fix, 'GPS ?')} {now.satellites}"
    ekf = "EKF ok" if now.ekf else "EKF not ready"
    parts = [battery.replace("   ", " "), gps, ekf]
    parts += [f"{now.received:.0f} messages/s" if math.isfinite(now.received) else ""]
    parts += [f"recorded {labels.size(now.recorded)}"]
    for part in parts if width >= 110 else parts[:3]:
        if part and text.cell_len + len(part) + 2 <= width:
            text.append(f"  {part}", palette.ink)
    return text


def _link(state: State, palette: Palette) -> tuple[str, str]:
    if state.played is not None:
        played = state.played
        pace = "PAUSED" if played.rate == 0 else f"x{played.rate:g}"
        return (
            f"▶ REPLAY {minutes_seconds(played.t)} of {minutes_seconds(played.length)} {pace}",
            palette.accent,
        )
    if state.lost:
        return "✗ LINK LOST", palette.bad
    if state.vehicle is not None:
        return "● LINK", palette.good
    return "○ no link", palette.quiet


def minutes_seconds(t: float) -> str:
    """A time [s] as minutes:seconds."""
    return f"{int(t) // 60}:{int(t) % 60:02d}"


def message(state: State, palette: Palette, width: int, last: bool = True, waited: float = 0.0) -> Text:
    """During a run, how to abort it; else the pending request and its time `waited` [s]; else the failure;
    else, with `last`, the last line of the log."""
    if state.aborting:
        return Text(" ABORTING - releasing the rover ".center(width), palette.alarming, no_wrap=True)
    if state.under_way:
        return Text(f" RUN IN PROGRESS - {ABORT_WORDS} ABORTS ".center(width), palette.alarming, no_wrap=True)
    if state.asked:
        since = f"{waited:.0f} s " if waited >= _LONG else ""
        work = since + ": ".join(filter(None, (working_on(state.asked[0]), state.doing)))
        return Text(cut_line(f" … {work}", width), f"bold {palette.accent}", no_wrap=True)
    if state.failure:
        return Text(cut_line(f" ✗ {state.failure}", width), f"bold {palette.bad}", no_wrap=True)
    if not (state.messages and last):
        return Text("")
    line = state.messages[-1]
    style = {"warning": palette.doubtful, "error": palette.bad}.get(line.level, palette.quiet)
    return Text(cut_line(f" {LEVELS[line.level]}{line.text}", width), style, no_wrap=True)


def working_on(request: Request) -> str:
    """The pending request in words."""
    match request:
        case Connect():
            return f"connecting to {request.url}"
        case Preflight():
            return "running the checks"
        case Fix():
            return f"fixing: {request.name.replace('_', ' ')}"
        case DriveRequest():
            return f"driving {request.planned.name}"
        case FetchLogs():
            return "fetching the logs"
        case Play():
            return "playing"


def keys(bindings: Sequence[tuple[str, str]], palette: Palette, width: int) -> Text:
    """The active keys, in at most two rows."""
    rows, room = [Text(" ", no_wrap=True)], width - 1
    for key, what in bindings:
        need = len(key) + len(what) + 5
        if room < need:
            if len(rows) == 2:
                break
            rows.append(Text(" ", no_wrap=True))
            room = width - 1
        rows[-1].append(f" {key} ", palette.inverse).append(f" {what}  ", palette.ink)
        room -= need
    return Text("\n").join(rows)


def is_small(width: int, height: int) -> bool:
    """True for a window that cannot show a view."""
    return width < LEAST[0] or height < LEAST[1]


def too_small(state: State, task: Task, palette: Palette, width: int, height: int) -> Text:
    """Content for a window that is too small; during a run with the pilot's task and the abort keys."""
    rows = ScreenRows(palette, width, height)
    if state.under_way:
        rows.filled(f" {ABORT_WORDS} ABORTS", palette.alarming)
        rows.sentence(f"{task.big}: {task.sentence}", f"bold {palette.ink}", most=4)
    rows.sentence(f"The window is {width}x{height}; make it {LEAST[0]}x{LEAST[1]} or larger.", palette.ink)
    return rows.text()
