"""A bad link is called a bad link, and what is said of the rover is true over any link, after a reboot, and
beside another rover.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest import mock

import pytest
from virtual_faults import STRANGER, disarmed, power_lost, second_rover, weather
from virtual_faults import weather as link_weather
from virtual_line import VirtualLine
from virtual_pipe import FAIR, Weather
from virtual_promises import broken
from virtual_run import BOOT, SWEEP, Outcome, played, session_played
from virtual_world import At, Phase, World

from rover_sweep.errors import LinkError, UsageError
from rover_sweep.live.source import Verdict
from rover_sweep.live.verdict import judge
from rover_sweep.logs.readers.tlog import open_tlog
from rover_sweep.session.session import start_streams
from rover_sweep.vehicle.events import StreamsSet
from rover_sweep.vehicle.identity import check_applet, identify_vehicle
from rover_sweep.vehicle.link.connection import Access, VehicleClock
from rover_sweep.vehicle.link.inbox import BadLink
from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.parameters import read_all, write_parameter
from rover_sweep.vehicle.preflight.readiness import preflight
from rover_sweep.vehicle.run.follow import RebootWatch
from sitl.ground.ground_session import GroundLink

SLOWER = {  # than a good link, and no wrong word
    "20 % lost": Weather(drop=0.2),
    "20 % corrupted": Weather(corrupt=0.2),
    "5 % corrupted": Weather(corrupt=0.05),
    "30 % twice": Weather(duplicate=0.3),
    "30 % overtaken": Weather(reorder=0.3),
    "2 s late each way": Weather(delay=2.0),
    "3 s late each way": Weather(delay=3.0),
    "jitter 1.5 s": Weather(jitter=1.5),
    "20 % lost, 1 s late": Weather(drop=0.2, delay=1.0),
}


@contextmanager
def linked(
    folder: Path, down: Weather, up: Weather | None = None, seed: int = 1, **settings: float
) -> Iterator[tuple[World, Link]]:
    world = World(folder / "vehicle", settings, seed=seed, limit=400.0)
    world.run(BOOT)
    world.down.weather, world.up.weather = down, down if up is None else up
    with Link.open("virtual:", folder / "a.tlog", line=VirtualLine(world)) as link:
        yield world, link


@contextmanager
def without(*names: str) -> Iterator[None]:
    """Vehicles that answer for no parameters of these names or beginnings."""
    answer = GroundLink._on_param_request_read

    def answered(link: GroundLink, message: Any) -> None:
        if not message.param_id.startswith(names):
            answer(link, message)

    with mock.patch.object(GroundLink, "_on_param_request_read", answered):
        yield


@pytest.mark.parametrize("weather", SLOWER)
@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_a_poor_link_is_only_slower(tmp_path: Path, weather: str, seed: int) -> None:
    with linked(tmp_path, SLOWER[weather], seed=seed) as (world, link):
        assert identify_vehicle(link).firmware.startswith("ArduRover")
        assert check_applet(link)["SWP_ENABLE"] == 1
        assert write_parameter(link, "SWP_AMP", 123).value == 123
        streams = [e.streams for e in start_streams(link) if isinstance(e, StreamsSet)]
        assert not [s.message for s in streams[0] if s.hz == 0]


@pytest.mark.parametrize("up", [True, False])
def test_one_direction_may_lose_half(tmp_path: Path, up: bool) -> None:
    bad = Weather(drop=0.5)
    with linked(tmp_path, FAIR if up else bad, bad if up else FAIR) as (_, link):
        identify_vehicle(link)
        assert check_applet(link)["SWP_ENABLE"] == 1


def test_a_list_comes_over_a_poor_link(tmp_path: Path) -> None:
    with linked(tmp_path, Weather(drop=0.2)) as (world, link):
        assert world.vehicle.rover is not None
        assert len(read_all(link)) == len(world.vehicle.rover.parameters.listed())


def test_a_link_too_bad_is_named(tmp_path: Path) -> None:
    sentence = r"the link loses [67]\d% of the frames \(measured over \d+ s\); move"
    with linked(tmp_path, Weather(drop=0.7)) as (_, link), pytest.raises(BadLink, match=sentence):
        identify_vehicle(link)
        check_applet(link)


def test_an_absence_is_no_conclusion_over_a_bad_link(tmp_path: Path) -> None:
    sentence = r"did not answer for SWP_.*the link loses [56]\d% of the frames"
    bad = linked(tmp_path, Weather(drop=0.6))
    with without("SWP_"), bad as (_, link), pytest.raises(BadLink, match=sentence):
        check_applet(link)


@pytest.mark.parametrize(
    ("weather", "lacking", "sentence"),
    [
        (FAIR, ("SWP_DWELL",), r"another version \(no SWP_DWELL\)"),
        (SLOWER["20 % lost"], ("SWP_", "SCR_"), "no Lua scripting"),
        (SLOWER["2 s late each way"], ("SWP_",), "does not run .no parameter SWP_ENABLE"),
    ],
)
def test_what_is_absent_is_said_so(tmp_path, weather, lacking, sentence):
    with without(*lacking), linked(tmp_path, weather) as (_, link):
        identify_vehicle(link)
        with pytest.raises(LinkError, match=sentence) as raised:
            check_applet(link)
        assert not isinstance(raised.value, BadLink)


def test_a_hole_while_parameters_are_asked_is_no_absence(tmp_path: Path) -> None:
    """3 s without any frame, from the first question on."""
    with linked(tmp_path, FAIR) as (world, link):
        identify_vehicle(link)
        ends = world.now + 3.0

        def hole(world: World) -> None:
            world.down.weather = world.up.weather = Weather(hole=True) if world.now < ends else FAIR

        world.each_step.append(hole)
        assert check_applet(link)["SWP_ENABLE"] == 1


def test_a_link_that_becomes_slow_is_no_absence(tmp_path: Path) -> None:
    with linked(tmp_path, FAIR) as (world, link):
        identify_vehicle(link)
        assert write_parameter(link, "SWP_AMP", 120).value == 120
        world.run(0.1)
        world.down.weather = world.up.weather = Weather(delay=2.0)
        for _ in range(3):
            link.wait_for("HEARTBEAT", 2.5)
        assert check_applet(link)["SWP_ENABLE"] == 1
        assert link.quality.latency == pytest.approx(4.0, abs=0.1)


def test_acknowledgements_that_come_twice_are_taken_once(tmp_path: Path) -> None:
    with linked(tmp_path, Weather(duplicate=1.0), FAIR) as (_, link):
        assert link.command("MAV_CMD_SET_MESSAGE_INTERVAL", 30, 20_000) == 2  # 50 Hz at a loop of 50: denied
        assert link.command("MAV_CMD_SET_MESSAGE_INTERVAL", 30, 100_000) == 0
        assert link.quality.duplicated == pytest.approx(0.5, abs=0.05)


@pytest.mark.parametrize(
    ("weather", "state", "words"),
    [
        (FAIR, "good", "measured on"),
        (Weather(drop=0.3), "bad", r"the link loses (2[5-9]|3[0-5])% of the frames \("),
    ],
)
def test_preflight_has_a_line_on_the_link(tmp_path: Path, weather: Weather, state: str, words: str) -> None:
    with linked(tmp_path, weather) as (_, link):
        checks = {check.name: check for check in preflight(link, tmp_path)}
    assert checks["link"].state == state
    assert re.search(words, checks["link"].sentence), checks["link"]
    assert checks["applet"].seen not in ("does not run", "another", "no scripting")


def test_preflight_over_a_link_too_bad_says_only_that(tmp_path: Path) -> None:
    with linked(tmp_path, Weather(drop=0.7)) as (_, link):
        (check,) = preflight(link, tmp_path)
    assert (check.name, check.state, check.seen) == ("link", "bad", "too poor")
    assert "the link loses" in check.sentence


# ---- A rover that loses its power in a run is said to have rebooted; a run that the applet stops is not.


@pytest.mark.parametrize("phase", ["waiting", "straight", "sweep"])
def test_a_reboot_is_called_a_reboot(tmp_path: Path, phase: Phase) -> None:
    outcome = played(tmp_path, [(At(phase, 0.5), power_lost(2.0))], after=1.0, limit=60.0)
    assert outcome.fired and outcome.finished is not None and not outcome.finished.completed
    assert outcome.finished.reason.startswith("the rover rebooted in run 1; check its power supply")
    assert "stopped by the applet" not in outcome.said


def test_a_run_that_the_applet_stops_is_no_reboot(tmp_path: Path) -> None:
    outcome = played(tmp_path, [(At("sweep", 0.5), disarmed())], after=1.0, limit=60.0)
    assert outcome.finished is not None and "disarmed" in outcome.finished.reason
    assert "rebooted" not in outcome.said


def test_only_a_run_that_was_not_whole_before_is_ended_by_a_reboot() -> None:
    clock = VehicleClock(now=100.0, known=True)
    watch = RebootWatch.since_now(clock)
    assert watch.outcome(3, (False, "why")) == (False, "why")
    clock.boots += 1
    assert watch.outcome(3, (False, "why"))[1].startswith("the rover rebooted in run 3")
    assert watch.outcome(3, (True, "whole")) == (True, "whole")


@pytest.mark.parametrize("weather", [FAIR, Weather(drop=0.1)])
def test_a_poor_link_is_named_after_the_run(tmp_path: Path, weather: Weather) -> None:
    bad = weather is not FAIR
    happenings = [(At("straight"), link_weather("10 % lost", weather))] if bad else []
    outcome = session_played(tmp_path, happenings, after=1.0, back=1.0)
    assert outcome.finished is not None
    assert (re.search(r"after sweep1: the link loses \d+% of the frames", outcome.said) is not None) == bad


# ---- A second rover on the channel: asked for at the start, and without any effect later.


def whole(outcome: Outcome) -> None:
    """The run came to its end as if there were no other rover."""
    assert outcome.fired and outcome.error is None, outcome.error
    assert outcome.finished is not None and outcome.finished.completed
    assert outcome.record.completed == (1,) and outcome.finished.number == 1
    assert broken(outcome) == []


def test_without_a_word_on_which_one_nothing_moves(tmp_path: Path) -> None:
    outcome = played(tmp_path, [(At("connecting"), second_rover())], after=2.0)
    assert isinstance(outcome.error, UsageError)
    assert f"system 1 (ground rover), system {STRANGER} (ground rover)" in outcome.said
    assert outcome.record.metres == 0.0 and outcome.record.sent == [] and not outcome.armed


def test_the_chosen_one_drives_and_the_other_counts_for_nothing(tmp_path: Path) -> None:
    outcome = played(tmp_path, [(At("connecting"), second_rover())], after=2.0, access=Access(system=1))
    whole(outcome)
    found = open_tlog(tmp_path / "sweep1.tlog", frozenset({"NAMED_VALUE_FLOAT", "HEARTBEAT"})).messages
    assert {system for frames in found.values() for system in frames.system.tolist()} == {1}


@pytest.mark.parametrize("phase", ["uploading", "sweep"])
def test_one_that_comes_later_changes_nothing_and_is_told_once(tmp_path: Path, phase: Phase) -> None:
    told: list[str] = []
    outcome = played(tmp_path, [(At(phase, 0.3), second_rover())], after=2.0, access=Access(tell=told.append))
    whole(outcome)
    assert [f"system {STRANGER} (ground rover)" in words for words in told] == [True]


# ---- A run driven over a poor link gets the verdict and the amplitude of one driven over a good link.

LONG = replace(SWEEP, t_rec=20.0)


def judged(folder: Path, kind: Weather) -> Verdict:
    """From the telemetry alone; at this seed no band is at a limit between two words."""
    outcome = played(
        folder, [(At("straight"), weather("poor", kind))], manoeuvre=LONG, after=1.0, back=1.0, seed=4
    )
    assert outcome.finished is not None and outcome.finished.completed, outcome.said
    return judge(folder / "sweep1.tlog", outcome.finished.span, "sweep1")


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Verdict:
    return judged(tmp_path_factory.mktemp("good"), FAIR)


@pytest.mark.parametrize("kind", [Weather(drop=0.05), Weather(jitter=0.5)], ids=str)
def test_the_verdict_is_that_of_a_good_link(tmp_path: Path, good: Verdict, kind: Weather) -> None:
    poor = judged(tmp_path, kind)
    assert (poor.advice, good.advice) == ("keep", "keep")
    assert poor.amplitude == pytest.approx(good.amplitude, rel=0.2)
    for response in ("r", "ay"):
        found, wanted = (
            [(b.words, b.coherence) for b in v.bands if b.response == response] for v in (poor, good)
        )
        assert [words for words, _ in found] == [words for words, _ in wanted]
        for (_, coherence), (_, there) in zip(found, wanted, strict=True):
            assert coherence == pytest.approx(there, abs=0.1)
