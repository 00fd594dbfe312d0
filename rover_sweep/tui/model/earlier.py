"""Runs, logs and plan of a continued session, from its folder."""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite
from pathlib import Path
from typing import Any, get_args

from rover_sweep.live.snapshot import Advice, CoherenceBand, ResponseCurve, Verdict
from rover_sweep.manoeuvre.sweep import Sweep
from rover_sweep.session.content import Content, DrivenRun, SessionRun
from rover_sweep.tui.model.plan_rows import SPEED, Row
from rover_sweep.tui.model.state import Outcome, RunRecord

_OUTCOMES: Mapping[str, Outcome] = {"done": "done", "stopped": "stopped", "cut": "failed", "begun": "failed"}


def records(content: Content, folder: Path) -> tuple[RunRecord, ...]:
    """The driven runs, oldest first."""
    return tuple(_record(run, folder) for run in content.runs)


def fetched_logs(content: Content, folder: Path) -> tuple[Path, ...]:
    """The vehicle's logs in the folder."""
    return tuple(folder / log.file for log in content.logs)


def rows(content: Content) -> tuple[Row, ...]:
    """The saved plan as rows."""
    return tuple(Row(run.manoeuvre, run.speed or SPEED, run.name) for run in content.plan)


def runs_of_plan(plan: tuple[Row, ...]) -> tuple[SessionRun, ...]:
    """The plan in the form saved in the folder."""
    return tuple(SessionRun(row.name, row.manoeuvre, row.speed) for row in plan)


def _record(run: DrivenRun, folder: Path) -> RunRecord:
    outcome = _OUTCOMES[run.state]
    return RunRecord(
        run.name,
        run.manoeuvre or Sweep(),
        outcome,
        _reason(run, outcome),
        run.number,
        folder / run.tlog,
        _verdict(run.verdict),
    )


def _reason(run: DrivenRun, outcome: Outcome) -> str:
    if outcome != "done":
        return run.reason
    return "" if run.verdict else "no verdict: the program ended first; 7 can still identify it"


def _verdict(saved: Mapping[str, Any] | None) -> Verdict | None:
    """The saved verdict; None if missing, or written by another version."""
    if saved is None:
        return None
    try:
        amplitude = saved.get("amplitude")
        if saved["advice"] not in get_args(Advice) or not isfinite(amplitude or 0.0):
            return None
        return Verdict(
            str(saved["run"]),
            saved["advice"],
            str(saved["sentence"]),
            tuple(_band(**band) for band in saved.get("bands") or ()),
            amplitude,
            tuple((float(a), float(b), float(c)) for a, b, c in saved.get("per_band") or ()),
            remarks=tuple(str(remark) for remark in saved.get("remarks") or ()),
            curves=tuple(_curve(**curve) for curve in saved.get("curves") or ()),
            throttle=_step(*saved["throttle"]) if saved.get("throttle") else None,
        )
    except (KeyError, TypeError, ValueError, OverflowError):
        return None


def _band(response: str, low: float, high: float, coherence: float, words: str) -> CoherenceBand:
    return CoherenceBand(str(response), float(low), float(high), float(coherence), str(words))


def _step(driven: int, proposed: int) -> tuple[int, int]:
    return int(driven), int(proposed)


def _curve(response: str, steering: str = "us", **numbers: list[float]) -> ResponseCurve:
    given = {name: tuple(map(float, x)) for name, x in numbers.items()}
    return ResponseCurve(str(response), **given, steering="rad" if steering == "rad" else "us")
