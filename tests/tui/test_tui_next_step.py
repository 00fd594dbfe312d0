"""N in the plan view: the next step with its reason; its run is added to the plan, not driven."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncGenerator
from dataclasses import replace

import pytest
from scenes import OWN, SETUP, playing
from scripted_source import connected, finished, under_way
from seen import text_of

from rover_sweep.live.source import DriveRequest, Ended, Preflight
from rover_sweep.tui.jobs import AnalysisJob

WHY = "steering_deadband explains the runs as well as steering_backlash; sweep of 240 us at 1.4 m/s decides"
CHOSEN = {
    "sentence": WHY,
    "proposal": [{"kind": "sweep", "amplitude_us": 240.0, "speed": 1.4, "bias_us": 0.0, "repeat": 1}],
    "settles": [WHY],
}
DRIVEN = (
    "enter", connected(), [Ended(Preflight())], "3", "g", "y", under_way(), finished(), "3",
)  # fmt: skip


def answering(monkeypatch: pytest.MonkeyPatch, document: object, outcome: str = "done") -> list[AnalysisJob]:
    """Every job ends at once with this document; the jobs that were started."""
    started = []

    async def ran(job: AnalysisJob) -> AsyncGenerator[AnalysisJob, None]:
        started.append(job)
        yield replace(job, outcome=outcome, output=json.dumps(document), lines=("it failed",))  # type: ignore[arg-type]

    monkeypatch.setattr("rover_sweep.tui.jobs.run_job", ran)
    return started


def test_the_run_is_added_with_its_reason_and_drives_only_after_its_own_yes(monkeypatch):
    async def run() -> None:
        async with playing(("3",), (110, 30), SETUP) as (app, source, pilot):
            await pilot.press("n")
            await pilot.pause()
            assert "next step" not in text_of(app) and not started, "without a complete run"
        async with playing(DRIVEN, (110, 30), replace(SETUP, settings=OWN)) as (app, source, pilot):
            rows, drives = len(app.plan), len([r for r in source.asked if isinstance(r, DriveRequest)])
            chosen = app.chosen
            await pilot.press("n")
            await pilot.pause()
            assert len(app.plan) == rows + 1 and app.plan[-1].settles == WHY and app.chosen == chosen
            assert app.plan[-1].speed == 1.4 and app.plan[-1].manoeuvre.amplitude == 240.0
            assert "Next step: steering_deadband explains" in text_of(app)
            assert len([r for r in source.asked if isinstance(r, DriveRequest)]) == drives == 1
            source.tell(Ended(source.asked[-1]))
            app.choose(rows)
            await pilot.pause()
            await pilot.press("g")
            await pilot.pause()
            assert "Is the area clear" in text_of(app)
            assert len([r for r in source.asked if isinstance(r, DriveRequest)]) == 1

    started = answering(monkeypatch, CHOSEN)
    asyncio.run(run())
    (job,) = started
    assert job.arguments[0] == "investigate" and "--connect" not in job.arguments


@pytest.mark.parametrize(
    ("document", "outcome", "said"),
    [
        ({"sentence": "steering_backlash: no look-alike is left"}, "done", "no look-alike is left"),
        ({}, "failed", "no next step: it failed"),
        ([1], "done", "no next step: "),
    ],
)
def test_a_settled_answer_and_a_failure_are_shown_and_add_nothing(monkeypatch, document, outcome, said):
    async def run() -> None:
        async with playing(DRIVEN, (110, 30), replace(SETUP, settings=OWN)) as (app, _, pilot):
            rows = len(app.plan)
            await pilot.press("n")
            await pilot.pause()
            assert said in text_of(app) and len(app.plan) == rows

    answering(monkeypatch, document, outcome)
    asyncio.run(run())
