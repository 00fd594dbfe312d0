"""One run on the vehicle, as a generator of events.

Nothing arms or moves unless `RunSettings` says so. However the run ends (done, exception, Ctrl-C, the
generator closed, the link lost) the switch goes low, throttle and steering go to trim, the rover is
disarmed if this program armed it, and the override is released. What is the pilot's stays the pilot's;
only Ctrl-C also tells the applet to stop. While something of ours moves the rover, `RightToMove` says at
every look at the link whether it still may; once it may not, the run is over.

Stop paths that need no laptop, all on the vehicle: the pilot throws the switch low, disarms or
changes the mode; RC_OVERRIDE_TIME after our last override (1 s where we drive) the switch is the radio's
again and the applet stops; the applet stops on RC loss, GCS loss (SWP_GCS) and on its own limits; its servo
override has a timeout, so that even a script error hands steering back within a fraction of a second. It
begins no second run for one SWP_GO, which is written anew for each run.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Iterator, Mapping
from pathlib import Path

from rover_sweep.errors import LinkError, RoverSweepError
from rover_sweep.manoeuvre.applet_values import parameters_of
from rover_sweep.manoeuvre.sweep import Manoeuvre
from rover_sweep.vehicle.events import (
    Armed,
    Event,
    Notice,
    ParameterSet,
    RunFinished,
    RunStarted,
    SwitchWanted,
)
from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.link.mavlink import Message
from rover_sweep.vehicle.link.requests import Refused
from rover_sweep.vehicle.link.streams import StreamMonitor
from rover_sweep.vehicle.parameters.override_time import RADIO_MISSED, RADIO_MISSED_SINCE, Lapse
from rover_sweep.vehicle.parameters.read_write import read_present, write_parameter
from rover_sweep.vehicle.run.before_run import await_rest, catch_up, refuse_blind, write_go
from rover_sweep.vehicle.run.controls import (
    MANUAL,
    SCRIPTING_1,
    Controls,
    Trigger,
    find_channels,
    overridden,
    pump,
)
from rover_sweep.vehicle.run.follow import Follower
from rover_sweep.vehicle.run.outcome import hear_outcome
from rover_sweep.vehicle.run.reboot_watch import RebootWatch
from rover_sweep.vehicle.run.right_to_move import MovementLimits, RightToMove
from rover_sweep.vehicle.run.settings import RunSettings

_STEERING_FUNCTION = 26  # SERVOn_FUNCTION GroundSteering
_SWITCH_LOW = 1200  # us, below which an auxiliary switch is low (RC_Channel.cpp, 4.6.3)
_START_LIMIT = 10.0  # s of the vehicle's clock from our switch to the applet's first state
_ARMING_LIMIT = 60.0  # s that we try to arm for: a yes is not good for ever
_LOOK, _ASKED = 0.1, 0.3  # s
_BEFORE_ARMING = 1.0  # s: the radio inputs must show our override before the arming checks
_JUDGED = frozenset({"SERVO_OUTPUT_RAW", "ATTITUDE", "RAW_IMU"})
# Read at the start of each run, so that its .tlog explains itself (filters, steering output, limits).
_SELF_DESCRIBING = (
    *(
        "INS_GYRO_FILTER",
        "INS_ACCEL_FILTER",
        "SCHED_LOOP_RATE",
        "LOG_BITMASK",
        "SWP_STILL",
        "SWP_V_MAX",
        "RC_OVERRIDE_TIME",
        "FS_THR_ENABLE",
    ),
    *(f"SERVO{n}_{what}" for n in (1, 2, 3, 4) for what in ("FUNCTION", "TRIM", "MIN", "MAX", "REVERSED")),
)


def one_run(
    link: Link, manoeuvre: Manoeuvre, name: str, tlog: Path, settings: RunSettings
) -> Generator[Event, None, RunFinished]:
    """Upload, arm and trigger as far as `settings` allow, follow, and let go. Returns the last event too.

    LinkError where the vehicle refuses, the applet does not start, or the link is lost for good; a
    manoeuvre that ended early is a `RunFinished` with completed False. Whatever exception ends it carries
    what could not be let go as its notes.
    """
    link.record_to(tlog)
    began = link.line.monotonic(), link.clock.now
    yield from _upload(link, parameters_of(manoeuvre, **settings.extra))
    newer = (RADIO_MISSED,) if link.version >= RADIO_MISSED_SINCE else ()
    present = read_present(link, (*_SELF_DESCRIBING, *newer))
    refuse_blind(present, settings)
    channels = find_channels(link)
    follower, monitor = Follower(_steering_output(present)), StreamMonitor(_JUDGED)
    reboots = RebootWatch.since_now(link.clock)
    asked = link.line.monotonic()
    yield RunStarted(name, manoeuvre, tlog)
    drives = settings.throttle_us is not None
    ours = overridden(channels, settings.trigger, drives)
    lapse = Lapse(link, present, began if ours else None)
    limit = manoeuvre.duration + 2 * present.get("SWP_STILL", 0.0) + settings.patience + _START_LIMIT
    with link.listening(_into(follower, link), follower.text):
        if link.line.monotonic() - asked > _ASKED:  # the user was asked, perhaps for minutes
            catch_up(link)
        right = RightToMove(link.line, link.clock, _limits(manoeuvre, present, drives, ours))
        controls = Controls(link, channels, settings.trigger, drives, right)
        with link.listening(right.message):
            try:
                yield from await_rest(link, follower, settings)
                lapse.shorten()
                start = yield from _start(link, controls, follower, settings, right)
                with link.listening(monitor):
                    yield from _follow(link, controls, follower, settings, limit, right)
            except BaseException as error:
                told, failed = _told_to_stop(error, link, settings), controls.let_go()
                for failure in [*told, *lapse.put_back(right.heard), *failed]:
                    error.add_note(failure)
                raise
            failures = controls.let_go()
            failures = [*lapse.put_back(right.heard), *failures]
            holds_switch = settings.trigger == "override"
            outcome = hear_outcome(link, follower, right, name, failures, holds_switch)
        yield from follower.take()
    for failure in failures:
        yield Notice("warning", f"after {name}: {failure}")
    if settings.trigger == "pilot":
        yield SwitchWanted("low", channels.switch)
    completed, reason = reboots.outcome(follower.number, outcome)
    finished = RunFinished(
        name, completed, reason, tlog, (start, follower.ended_at), follower.number, monitor.quality()
    )
    yield finished
    return finished


def _into(follower: Follower, link: Link) -> Callable[[Message], None]:
    return lambda message: follower.message(message, link.clock.now)


def _limits(
    manoeuvre: Manoeuvre, present: Mapping[str, float], drives: bool, ours: Mapping[int, int]
) -> MovementLimits:
    return MovementLimits(
        drives=drives,
        ours=frozenset(ours),
        manoeuvre=manoeuvre.duration,
        still=present.get("SWP_STILL", 0.0),
        v_max=present.get("SWP_V_MAX", math.inf),
    )


def _told_to_stop(error: BaseException, link: Link, settings: RunSettings) -> list[str]:
    """Ctrl-C where the switch is the pilot's: the applet is told to stop as if it had gone low."""
    if settings.trigger != "pilot" or not isinstance(error, KeyboardInterrupt):
        return []
    try:
        link.require("stop the applet", "MAV_CMD_DO_AUX_FUNCTION", float(SCRIPTING_1), 0.0)
    except RoverSweepError as failure:
        return [f"{failure}; throw the switch low"]
    return []


def _upload(link: Link, values: Mapping[str, float]) -> Iterator[Event]:
    for name, value in values.items():
        written = write_parameter(link, name, value)
        if written.changed:
            yield ParameterSet(written.name, written.old, written.value)


def _start(
    link: Link, controls: Controls, follower: Follower, settings: RunSettings, right: RightToMove
) -> Generator[Event, None, float]:
    """Arm, throw the switch and wait for the applet; returns the vehicle's time of the switch [s]."""
    controls.take()
    yield from _arm(link, controls, follower, settings)
    yield from follower.take()
    yield Armed(link.clock.now)
    if link.mode != MANUAL:
        yield Notice("warning", f"the rover is not in MANUAL (mode {link.mode}); the applet will not start")
    yield from follower.take()
    write_go(link)
    follower.begin()
    start = link.clock.now
    pilot = settings.trigger == "pilot"
    if pilot:
        yield SwitchWanted("high", controls.channels.switch)
    right.thrown(follower.number)
    controls.throw()
    patience = settings.patience if pilot else _START_LIMIT
    while not follower.active:
        if follower.refused:
            raise LinkError(f"the applet refuses the run: {follower.refused}")
        if link.clock.now - start > patience:
            raise LinkError(_not_started(link, controls, settings.trigger, patience))
        if right.lost:
            return start
        link.receive(_LOOK)
        yield from follower.take()
    return start


def _arm(link: Link, controls: Controls, follower: Follower, settings: RunSettings) -> Iterator[Event]:
    """Arm, again and again while the vehicle is not ready; or wait until the pilot did."""
    started, told = link.clock.now, ""
    patience = min(settings.patience, _ARMING_LIMIT) if settings.arm else settings.patience
    if not settings.arm and not link.armed:
        yield Notice("info", "waiting for the pilot to arm, in MANUAL")
    while not link.armed:
        if link.clock.now - started > patience:
            waited = f"the rover was not armed within {patience:.0f} s"
            raise LinkError(f"{waited}: {told}" if told else waited)
        yield from follower.take()
        if not settings.arm:
            link.receive(0.5)
            continue
        pump(link, _BEFORE_ARMING)
        try:
            controls.arm()
        except Refused as refused:
            if str(refused) != told:
                yield Notice("info", f"{refused}; trying for {patience:.0f} s")
            told = str(refused)
        else:
            link.wait_for("HEARTBEAT", 3.0, lambda _: link.armed)


def _not_started(link: Link, controls: Controls, trigger: Trigger, patience: float) -> str:
    said = [text.text for text in link.texts if text.text.startswith("SWP")]
    number = controls.channels.switch
    sentence = f"the applet did not start within {patience:.0f} s of switch {number}"
    if said:
        return f"{sentence}; it says: {said[-1]}"
    radio = None if trigger == "override" else link.wait_for("RC_CHANNELS", 1.0)
    pwm = getattr(radio, f"chan{number}_raw", 0)
    if _SWITCH_LOW <= pwm < 0xFFFF:
        return (
            f"{sentence}: the radio holds that channel at {pwm} us, and the applet waits for it to be low "
            f"(below {_SWITCH_LOW} us); throw switch {number} low and begin again"
        )
    return f"{sentence} and says nothing; does it run (SCR_ENABLE 1)?"


def _follow(
    link: Link,
    controls: Controls,
    follower: Follower,
    settings: RunSettings,
    limit: float,
    right: RightToMove,
) -> Iterator[Event]:
    """Follow the applet to its end, or until the right to move is lost; drives in its states 2 to 8."""
    deadline = link.clock.now + limit
    while not follower.ended and not right.lost:
        if link.clock.now > deadline:
            yield Notice("warning", f"the applet did not end within {limit:.0f} s (state {follower.state})")
            return
        if settings.throttle_us is not None:
            moving = 2 <= follower.state <= 8
            controls.throttle(settings.throttle_us if moving else controls.channels.throttle_trim)
        link.receive(_LOOK)
        yield from follower.take()


def _steering_output(present: Mapping[str, float]) -> int:
    """Servo output (1-based) that steers; 1 as ArduPilot's default where none of 1-4 says so."""
    return next((n for n in range(1, 5) if present.get(f"SERVO{n}_FUNCTION") == _STEERING_FUNCTION), 1)
