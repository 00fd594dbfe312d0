"""What is told of tries, reports and sessions of before; without a screen."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import replace
from functools import reduce as folded
from pathlib import Path

from scripted_source import ROVER, SWEEP, TLOG, snapshot

from rover_sweep.live.source import CoherenceBand, DriveRequest, Lost, Preflight, Update, Verdict
from rover_sweep.session.content import Content, DrivenRun, FetchedLog, SessionRun
from rover_sweep.tui.drawn import LIGHT
from rover_sweep.tui.jobs import Analyses, AnalysisJob, summary_of
from rover_sweep.tui.model.plan_rows import Row, task
from rover_sweep.tui.model.setup import fetched_logs, is_kept, records
from rover_sweep.tui.model.state import AbortAsked, Asked, Own, RunRecord, State, reduce
from rover_sweep.tui.screens.frame import message, status
from rover_sweep.tui.screens.plan import last_outcome
from rover_sweep.tui.screens.run import why_kept
from rover_sweep.vehicle.events import Connected, Rebooting
from rover_sweep.vehicle.run.controls import RunSettings

DRIVE = DriveRequest(SessionRun("sweep1", SWEEP, 2.0), RunSettings())


def reduced(state: State, many: Iterable[Update | Own]) -> State:
    return folded(reduce, many, state)


def done(kind: str, out: str) -> AnalysisJob:
    return AnalysisJob(kind, (kind, out), Path(out), "done")


def test_gains_come_from_the_chosen_report_else_from_the_latest_identification() -> None:
    analyses = Analyses(lambda: None)
    assert analyses.report() is None
    first, second, diagnosis = done("identify", "r1"), done("identify", "r2"), done("diagnose", "d")
    gains, failed = done("gains", "gains.param"), replace(done("identify", "r3"), outcome="failed")
    analyses.jobs = (diagnosis,)
    assert analyses.report() == Path("d")
    analyses.jobs = (first, second, diagnosis, gains, failed)
    assert analyses.report() == analyses.report(gains) == analyses.report(failed) == Path("r2")
    assert analyses.report(diagnosis) == Path("d") and analyses.report(first) == Path("r1")
    of_it = replace(gains, source=Path("d"))  # S again after a refusal asks the same diagnosis again
    analyses.jobs = (*analyses.jobs, of_it)
    assert analyses.report(of_it) == Path("d")


def test_reports_and_gains_of_before_are_found_again(tmp_path: Path) -> None:
    (tmp_path / "report").mkdir()
    (tmp_path / "report" / "report.html").touch()
    (tmp_path / "report-2").mkdir()  # cut short: no page
    (tmp_path / "gains.param").write_text("# by the model\nATC_STR_RAT_FF 0.97\n")
    jobs = Analyses(lambda: None, tmp_path).jobs
    assert [(job.kind, job.outcome) for job in jobs] == [("identify", "done"), ("gains", "done")]
    assert jobs[1].lines == ("# by the model", "ATC_STR_RAT_FF 0.97", f"parameters in {jobs[1].out}")


def test_the_latest_try_comes_first() -> None:
    row = Row(SWEEP, 2.0, "sweep1")
    tries = (
        RunRecord("sweep1", SWEEP, "stopped", "script paused 122 ms", 1, TLOG, began=True),
        RunRecord("sweep1", SWEEP, "failed", "no answer"),
        RunRecord("sweep1", SWEEP, "done", "", 2, TLOG, Verdict("sweep1", "keep", "keep"), began=True),
        RunRecord("sweep1", SWEEP, "failed", "the applet does not run"),
        RunRecord("sweep1", replace(SWEEP, amplitude=200.0), "done", "", 3, TLOG),
    )
    assert last_outcome(row, ()) == ""
    assert last_outcome(row, tries[:1]) == "✗ stopped"
    assert last_outcome(row, tries[1:2]) == "✗ failed"
    assert last_outcome(row, tries) == "✓ KEEP (1 before)", "a run that never began does not count"
    assert is_kept(row, tries)


def test_runs_and_logs_of_before(tmp_path: Path) -> None:
    content = Content(
        runs=(
            DrivenRun("sweep1", "sweep1.tlog", SWEEP, "done", "the manoeuvre ran to its end"),
            DrivenRun("sweep1", "sweep1-2.tlog", SWEEP, "cut", "the recording ends 12 s into the run"),
        ),
        logs=(FetchedLog("log1.BIN", 1, 10, 99, ("sweep1",)),),
    )
    whole, cut = records(content, tmp_path)
    assert whole.outcome == "done" and whole.reason.startswith("no verdict")
    assert (cut.outcome, cut.reason) == ("failed", "the recording ends 12 s into the run")
    assert fetched_logs(content, tmp_path) == (tmp_path / "log1.BIN",)


def test_the_recommended_model_comes_first_and_with_its_intervals(tmp_path: Path) -> None:
    estimate = {"value": 30.0, "unit": "N/rad", "free": True, "interval_90": [29.0, 31.5]}
    models = {name: {"parameters": {"C": estimate}} for name in ("bicycle", "roll-yaw")}
    document = {"summary": ["use the roll-yaw model"], "recommended": "roll-yaw", "models": models}
    (tmp_path / "identification.json").write_text(json.dumps(document))
    assert summary_of("identify", tmp_path) == (
        "use the roll-yaw model",
        "roll-yaw (recommended; 90 % intervals): C 30 (29 to 31.5) N/rad",
        "bicycle: C 30 N/rad",
    )


def test_what_takes_long_tells_since_when_and_what_it_does() -> None:
    asked = reduced(State(), (Connected("udp:1", ROVER), Asked(Preflight())))
    assert message(asked, LIGHT, 80).plain == " … running the checks"
    told = reduced(asked, (Rebooting(("SCR_ENABLE",)),))
    assert (
        message(told, LIGHT, 80, waited=31.4).plain
        == " … 31 s running the checks: rebooting the rover to apply SCR_ENABLE"
    )


def test_a_status_row_ends_with_a_whole_word() -> None:
    state = replace(State(), snapshot=snapshot(1.0), lost="nothing was heard for 3 s", runs=())
    for width in range(40, 120):
        row = status(state, LIGHT, width).plain
        assert "last heard:  ARMED" in row
        if width >= 60:
            assert row.rstrip().endswith(("HIGH", "%", "14", "ok", "messages/s", "MB")), row


def test_a_link_that_is_lost_leaves_nothing_to_abort_but_a_run_of_ours() -> None:
    steering = replace(snapshot(3.0), state=6)
    heard = reduced(State(), (steering,))
    assert heard.under_way
    lost = reduced(heard, (Lost("nothing was heard for 3 s"), AbortAsked()))
    assert not lost.under_way and not lost.aborting
    driving = reduced(State(), (Asked(DRIVE), steering, Lost("nothing was heard for 3 s"), AbortAsked()))
    assert driving.under_way and driving.aborting


def test_a_verdict_of_before_that_cannot_be_shown_is_left_out(tmp_path: Path) -> None:
    band = {"response": "r", "low": 1, "high": 2, "coherence": 0.9, "words": "good"}
    said = {"run": "sweep1", "advice": "keep", "sentence": "keep", "bands": [band], "amplitude": 150.0}

    def verdict(**other: object) -> Verdict | None:
        driven = DrivenRun("sweep1", "sweep1.tlog", SWEEP, "done", verdict=said | other)
        return records(Content(runs=(driven,)), tmp_path)[0].verdict

    assert verdict() == Verdict("sweep1", "keep", "keep", (CoherenceBand("r", 1, 2, 0.9, "good"),), 150.0)
    for wrong in (
        {"advice": "burn"},
        {"advice": []},
        {"amplitude": "x"},
        {"amplitude": float("nan")},
        {"bands": 3},
        {"bands": [band | {"low": "x"}]},
        {"per_band": [1]},
    ):
        assert verdict(**wrong) is None


def test_the_standstill_is_counted_down() -> None:
    still = tuple(snapshot(10.0 + 0.5 * k, state=1, speed=0.0) for k in range(3))
    moved = snapshot(9.5, state=0, speed=0.0)
    driving = State(asked=(DRIVE,), snapshot=still[-1], applet=1, history=(moved, *still))
    assert ", 2 s left" in task(driving).sentence
    rolling = replace(driving, applet=9, history=tuple(replace(one, state=9, speed=1.0) for one in still))
    assert ", 3 s left" in task(rolling).sentence, "it counts from where the rover stands"
    assert "left" not in task(replace(driving, history=())).sentence


def test_a_kept_run_with_a_weak_lateral_velocity_says_why() -> None:
    good, weak = CoherenceBand("r", 1, 2, 0.9, "good"), CoherenceBand("vydot", 1, 2, 0.4, "weak")
    assert why_kept(Verdict("sweep1", "keep", "keep", (good, weak), 150.0)).startswith("Weak bands of vydot")
    assert why_kept(Verdict("sweep1", "repeat", "repeat", (good, weak), 150.0)) == ""
    assert why_kept(Verdict("sweep1", "keep", "keep", (good,), 150.0)) == ""
