"""A second ground station on the rover's link, as behind mavlink-router or MAVProxy."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect
from virtual_faults import each_step
from virtual_run import applet_without, played, session_played
from virtual_world import At, Fault, World

from rover_sweep.vehicle.events import RunFinished
from rover_sweep.vehicle.run import right_to_move

OTHER, SAME = 254, 255  # system ids; 255 is that of this program, and of most other ground stations
MANUAL, HOLD = 0, 4
IGNORED = 0xFFFF


def station(name: str, says: Callable[[float], Iterator[Any]], system: int = OTHER) -> Fault:
    """A heartbeat a second, and what it says at each main loop. says: takes the time since it began [s]."""
    mav = dialect.MAVLink(None, srcSystem=system, srcComponent=190)
    began: list[int] = []

    def tell(world: World) -> None:
        began.append(world.now_us)
        since = (world.now_us - began[0]) * 1e-6
        beat = [dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3)] if len(began) % 50 == 1 else []
        for message in (*beat, *says(since)):
            world.vehicle.link.receive(bytes(message.pack(mav)))
            mav.seq = (mav.seq + 1) % 256

    return each_step(name, tell, float("inf"))


def once(*messages: Any) -> Callable[[float], Iterator[Any]]:
    return lambda since: iter(messages if since == 0.0 else ())


def override(**channels: int) -> Callable[[float], Iterator[Any]]:
    """RC overrides, ten times a second; other channels are left alone. channels: chan3=1900."""
    us = [channels.get(f"chan{n}", IGNORED) for n in range(1, 9)]
    message = dialect.MAVLink_rc_channels_override_message(1, 1, *us)
    return lambda since: iter([message] if round(since * 50) % 5 == 0 else ())


def parameter(name: str, value: float) -> Any:
    return dialect.MAVLink_param_set_message(1, 1, name.encode(), value, 9)


def command(number: int, *params: float) -> Any:
    return dialect.MAVLink_command_long_message(1, 1, number, 0, *(*params, *[0.0] * 7)[:7])


def streams(hz: int) -> Any:
    return dialect.MAVLink_request_data_stream_message(1, 1, 0, hz, 1)


SAYS_NOTHING = {
    "heartbeats alone": station("heartbeats", once()),
    "all parameters": station("reads", once(dialect.MAVLink_param_request_list_message(1, 1))),
    "slower streams": station("streams", once(streams(4))),
    "overrides of another id": station("overrides", override(chan3=1900, chan1=1900)),
}


@pytest.mark.parametrize("name", SAYS_NOTHING)
def test_a_station_that_only_listens_or_is_not_heard(tmp_path: Path, name: str) -> None:
    outcome = played(tmp_path, [(At("sweep", 1.0), SAYS_NOTHING[name])], after=2.0)
    assert outcome.fired and outcome.finished is not None and outcome.finished.completed
    assert outcome.said == "the manoeuvre ran to its end" and not outcome.armed


ENDS = {
    "throttle": (override(chan3=1900), SAME, "at 1900 us, which this program did not send"),
    "a little more throttle": (override(chan3=1760), SAME, "another ground station overrides it"),
    "steering": (override(chan1=1600), SAME, "RC channel 1 is at 1600 us, where this program sends 1500"),
    "switch": (override(chan6=1000), SAME, "RC channel 6 is at 1000 us, where this program sends 1900"),
    "mode": (once(command(176, 1, HOLD)), OTHER, "mode 4, not MANUAL"),
    "disarm": (once(command(400, 0, 21196)), OTHER, "disarmed"),
    "applet off": (once(parameter("SWP_ENABLE", 0)), OTHER, "SWP_ENABLE is 0"),
}


@pytest.mark.parametrize("name", ENDS)
def test_a_station_that_acts_ends_the_run(tmp_path: Path, name: str) -> None:
    says, system, words = ENDS[name]
    outcome = played(tmp_path, [(At("sweep", 1.0), station(name, says, system))], limit=60.0, after=5.0)
    assert outcome.error is None and outcome.finished is not None and not outcome.finished.completed
    assert words in outcome.said and not outcome.armed
    began = outcome.world.entered["sweep"] * 1e-6 + 1.0
    assert not any(row.armed for row in outcome.record.rows if row.t > began + 6.0)


def test_without_the_rule_the_other_drives_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rules = tuple(rule for rule in right_to_move.RULES if rule is not right_to_move.undisputed)
    monkeypatch.setattr(right_to_move, "RULES", rules)
    applet_without(monkeypatch, tmp_path, ('return string.format("thr %d us", throttle or 0)', "return nil"))
    fault = station("throttle", override(chan3=1760), SAME)
    outcome = played(tmp_path, [(At("sweep", 1.0), fault)], limit=40.0, after=1.0)
    row = next(row for row in outcome.record.rows if row.t > 38.0)
    assert row.armed and row.speed > 2.5


def test_parameters_that_change_under_a_run_are_told(tmp_path: Path) -> None:
    says = once(parameter("INS_GYRO_FILTER", 10), parameter("SWP_AMP", 250), parameter("BATT_CAPACITY", 1))
    outcome = played(tmp_path, [(At("sweep", 1.0), station("sets", says))], after=2.0)
    assert outcome.finished is not None and outcome.finished.completed
    (words,) = (line for line in outcome.said.splitlines() if "somebody else changed" in line)
    assert "INS_GYRO_FILTER from 4 to 10, SWP_AMP from 100 to 250 during the run" in words
    assert "BATT_CAPACITY" not in words


def test_a_speed_that_comes_too_rarely_names_the_other_station(tmp_path: Path) -> None:
    outcome = played(tmp_path, [(At("sweep", 1.0), station("streams", once(streams(1))))], after=2.0)
    assert outcome.finished is not None and not outcome.finished.completed and not outcome.armed
    assert "LOCAL_POSITION_NED" in outcome.said and "another ground station" in outcome.said


def test_rates_that_another_station_set_are_set_again_for_the_next_run(tmp_path: Path) -> None:
    """A session of two runs; during the first the other station asks for 4 Hz."""
    fault = station("streams", once(streams(4)))
    outcome = session_played(tmp_path, [(At("sweep", 1.0), fault)], runs=2)
    first, second = (e for e in outcome.events if isinstance(e, RunFinished))
    rates = [{q.message: q.mean_hz for q in run.quality} for run in (first, second)]
    assert rates[0]["ATTITUDE"] < 20.0 < 30.0 < rates[1]["ATTITUDE"]
    assert "the streams are requested again" in outcome.said
