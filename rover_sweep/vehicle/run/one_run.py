"""One run on the vehicle, as a generator of events.

Nothing arms or moves unless `RunSettings` says so. However the run ends (done, exception, Ctrl-C, the
generator closed, the link lost) the switch goes low, throttle and steering go to trim, the rover is
disarmed if this program armed it, and the override is released. The pilot's controls are not touched; only
Ctrl-C also stops the applet. While this program moves the rover, `RightToMove` decides at every pass of the
link whether it still may; once it may not, the run is over.

Stop paths on the vehicle, which need no laptop: the pilot throws the switch low, disarms or changes the mode;
if we drive, the applet puts the rover into HOLD 1.5 s after our last override, before it lapses
(`takeover`); the applet stops on RC loss, GCS loss (SWP_GCS) and on its own limits; its servo override has a
timeout, so that even after a script error the pilot steers again within a fraction of a second. The applet
starts only one run for each new value of SWP_GO, which is drawn before each run and tells whose run it is.
"""

from __future__ import annotations

import math
import random
import re
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

from firmware_params.applet_parameters import STATES, SWITCH_LOW
from rover_sweep.errors import LinkError, RoverSweepError, UsageError
from rover_sweep.manoeuvre.sweep import Manoeuvre, parameters_of
from rover_sweep.system import another_stop, hold_stops
from rover_sweep.vehicle.events import Armed, Event, Notice, RunFinished, RunStarted, SwitchWanted
from rover_sweep.vehicle.link.inbox import BadLink
from rover_sweep.vehicle.link.link import Link, Refused
from rover_sweep.vehicle.link.streams import StreamMonitor
from rover_sweep.vehicle.parameters import read_parameter, read_present, write_parameter
from rover_sweep.vehicle.run.controls import (
    MANUAL,
    SCRIPTING_1,
    Controls,
    RunSettings,
    Trigger,
    find_channels,
    overridden,
    pump,
)
from rover_sweep.vehicle.run.follow import Follower, ParameterWatch, RebootWatch
from rover_sweep.vehicle.run.right_to_move import MovementLimits, RightToMove
from rover_sweep.vehicle.run.takeover import OVERRIDE_TIME, Takeover

# Conditions before the rover is armed and its switch thrown, and the number that allows one run.


_REPORTS = 5.0  # s of the vehicle's clock; an idle applet reports once a second
_TOO_LATE, _TOO_LOSSY = 1.0, 0.35  # s from a request to its answer; share of the frames
_AT_REST, _COMES_TO_REST = 0.5, 20.0  # m/s; s
_STOPPED, _NUMBERS = 10, 65535


def refuse_blind(present: Mapping[str, float], settings: RunSettings) -> None:
    """UsageError if we would drive a rover that does not detect the loss of its transmitter.

    With FS_THR_ENABLE 0 the firmware sets no failsafe (Rover/radio.cpp, 4.6.3): SYS_STATUS reports a healthy
    receiver, and the applet's rc:has_valid_input stays true.
    """
    if settings.throttle_us is not None and present.get("FS_THR_ENABLE") == 0:
        raise UsageError(
            "FS_THR_ENABLE is 0: the rover would not detect the loss of the safety pilot's transmitter; "
            "set FS_THR_ENABLE to 1 (the check rc does), or let the pilot drive"
        )


def catch_up(link: Link) -> None:
    """Process the messages that arrived while nobody read, for example while the user was asked."""
    while link.receive(0.0) is not None:
        pass


def await_rest(link: Link, follower: Follower, settings: RunSettings) -> Iterator[Event]:
    """Wait, if we throw the switch or drive, until the applet is idle and the rover is at rest.

    LinkError if the link is too poor to drive over, if the applet does not report or is in a run, or if the
    rover does not come to rest.
    """
    if settings.trigger == "pilot" and settings.throttle_us is None:
        return
    _refuse_poor(link, settings)
    started, asked = link.clock.now, False
    while waits_for := _not_at_rest(follower, settings):
        waited = link.clock.now - started
        if waited > (_COMES_TO_REST if follower.reports else _REPORTS):
            raise LinkError(waits_for)
        if waited > _REPORTS and not asked:
            asked = True
            yield Notice("info", f"the run has not started yet: {waits_for}")
        link.receive(0.1)
        yield from follower.take()


def _refuse_poor(link: Link, settings: RunSettings) -> None:
    """BadLink if we would drive over a link that is too slow or too lossy to stop the rover in time."""
    quality = link.quality
    late = quality.latency is not None and quality.latency > _TOO_LATE
    if settings.throttle_us is not None and (late or quality.lost > _TOO_LOSSY):
        raise BadLink(f"the rover is not driven over this link: {quality.words}")


def _not_at_rest(follower: Follower, settings: RunSettings) -> str:
    if not follower.reports:
        return "the applet does not report its state (SWP_ST); look for script errors in the rover's messages"
    if follower.state not in (0, _STOPPED):
        state = STATES.get(follower.state, f"state {follower.state}")
        return f"the applet is already in a run ({state}); throw its switch low and start again"
    if settings.throttle_us is None:
        return ""
    if math.isnan(follower.speed):
        return "the rover does not send its speed (LOCAL_POSITION_NED); does its EKF have a position?"
    if follower.speed > _AT_REST:
        return f"the rover moves at {follower.speed:.1f} m/s; it must be at rest before the run"
    return ""


def drawn() -> int:
    """A number that no other program draws at the same time."""
    return random.SystemRandom().randrange(1, _NUMBERS)


def write_go(link: Link) -> int:
    """Allow the applet one run, by a new value of SWP_GO, and return it: it says whose run it is."""
    number = (int(read_parameter(link, "SWP_GO")) + drawn() - 1) % _NUMBERS + 1
    write_parameter(link, "SWP_GO", float(number))
    return number


# How a run ended: by the applet's report if it was heard, else by the reason why we stopped.


_OUTCOME_REPORTS = 3.0  # s: an idle applet reports its last completed run once a second
_LOST = 1.5  # s without a message
_OF_OUR_SWITCH = "switch low"
_NOT_RECEIVED = "the rover did not receive our override of the switch, which fell low"
_LAPTOP_LOST = re.compile(r"laptop lost: (?:silent|it left|RCMAP|thr (\d+) us)")


def hear_outcome(
    link: Link, follower: Follower, right: RightToMove, name: str, failures: list[str], holds_switch: bool
) -> tuple[bool, str]:
    """(completed, reason). LinkError, with `failures` as its notes, if the rover is not heard.

    holds_switch: we override the switch.
    """
    if right.lost and right.silence > _LOST:
        raise cut_off(right, name, failures)
    _wait(link, follower)
    completed, reason = follower.outcome
    if lost := _LAPTOP_LOST.fullmatch(reason):
        return False, right.contested or _held(lost[1])
    if completed or (follower.outcome_heard and reason != _OF_OUR_SWITCH):
        return completed, reason
    return False, right.lost or (_NOT_RECEIVED if holds_switch else reason)


def _held(throttle: str | None) -> str:
    """Why the applet took the rover from us. throttle: that the channel had instead of ours [us]."""
    if throttle is None:
        return "the rover did not receive this program's overrides any longer, and went into HOLD"
    return (
        f"the throttle channel was at {throttle} us, which this program did not send, so the rover went into "
        "HOLD: another ground station overrides it, or the override ended"
    )


def cut_off(right: RightToMove, name: str, failures: list[str]) -> LinkError:
    error = LinkError(
        f"{name} was stopped: {right.lost}, and the rover is still silent; check its power, the radio's "
        "range and the cable. The rover's log shows what it did since"
    )
    for failure in failures:
        error.add_note(failure)
    return error


def _wait(link: Link, follower: Follower) -> None:
    started, deadline = link.clock.now, link.line.monotonic() + _OUTCOME_REPORTS
    while not follower.outcome_heard and link.clock.now - started < _OUTCOME_REPORTS:
        if link.line.monotonic() > deadline:
            return
        link.receive(0.1)


STEERING_FUNCTION = 26  # SERVOn_FUNCTION GroundSteering
_START_LIMIT = 10.0  # s of the vehicle's clock from our switch to the applet's first state
_ARMING_LIMIT = 60.0  # s for which we try to arm: a consent does not last for ever
_LOOK, _ASKED = 0.1, 0.3  # s
_BEFORE_ARMING = 1.0  # s: the radio inputs must show our override before the arming checks
_SET_IN_A_RUN = (OVERRIDE_TIME, "SWP_GO", "SWP_RUN")  # by this program and by the applet
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
    link: Link,
    manoeuvre: Manoeuvre,
    name: str,
    tlog: Path,
    settings: RunSettings,
    note: Callable[[RunFinished], None] = lambda finished: None,
) -> Generator[Event, None, RunFinished]:
    """Upload, arm and trigger as far as `settings` allow, follow, and release. Also returns the last event.

    note: called once with the last event, as soon as the rover is released and before any later event; also
    where the manoeuvre ran to its end and an exception ends the run afterwards.

    LinkError if the vehicle refuses, if the applet does not start, or if the link is lost for good; a
    manoeuvre that ended early is a `RunFinished` with completed False. The exception that ends a run has
    notes on all that could not be released.
    """
    link.record_to(tlog)
    catch_up(link)  # an old clock would look like a fast simulation (`Takeover`)
    began = link.line.monotonic(), link.clock.now
    asked_for = parameters_of(manoeuvre, **settings.extra)
    yield from _upload(link, asked_for)
    present = read_present(link, _SELF_DESCRIBING)
    refuse_blind(present, settings)
    channels = find_channels(link)
    follower, monitor = Follower(_steering_output(present)), StreamMonitor(_JUDGED)
    watch = ParameterWatch({n: v for n, v in (present | asked_for).items() if n not in _SET_IN_A_RUN})
    reboots = RebootWatch.since_now(link.clock)
    asked = link.line.monotonic()
    yield RunStarted(name, manoeuvre, tlog)
    drives = settings.throttle_us is not None
    ours = overridden(channels, settings.trigger, drives)
    takeover = Takeover(link, channels, settings.throttle_us, present, began if ours else None)
    limit = manoeuvre.duration + 2 * present.get("SWP_STILL", 0.0) + settings.patience + _START_LIMIT
    start = link.clock.now

    def finished() -> RunFinished:
        completed, reason = reboots.outcome(follower.number, outcome)
        span = start, follower.ended_at
        return RunFinished(name, completed, reason, tlog, span, follower.number, monitor.quality())

    with link.listening(lambda message: follower.message(message, link.clock.now), follower.text):
        if link.line.monotonic() - asked > _ASKED:  # the user was asked, perhaps for minutes
            catch_up(link)
        right = RightToMove(link.line, link.clock, _limits(manoeuvre, present, drives, ours))
        controls = Controls(link, channels, settings.trigger, drives, right)
        with link.listening(right.message):
            try:
                yield from await_rest(link, follower, settings)
                takeover.check_sticks()
                start = yield from _start(link, controls, follower, settings, right, takeover)
                with link.listening(monitor), link.listening(watch.message):
                    yield from _follow(link, controls, follower, settings, limit, right)
            except BaseException as error:
                hold_stops()
                unstopped, failed = _stop_applet(error, link, settings), controls.let_go()
                for failure in [*unstopped, *takeover.end(right.heard), *failed]:
                    error.add_note(failure)
                outcome = follower.outcome
                if follower.ended and outcome[0]:
                    note(finished())
                raise
            failures = controls.let_go()
            failures = [*takeover.end(right.heard), *failures]
            holds_switch = settings.trigger == "override"
            with _noted(failures):
                outcome = hear_outcome(link, follower, right, name, failures, holds_switch)
        with _noted(failures):
            note(last := finished())
            yield from follower.take()
            for failure in (*failures, *filter(None, (watch.sentence,))):
                yield Notice("warning", f"after {name}: {failure}")
    if settings.trigger == "pilot":
        yield SwitchWanted("low", channels.switch)
    yield last
    return last


@contextmanager
def _noted(failures: Sequence[str]) -> Iterator[None]:
    """What could not be released is told by whatever exception comes before it was told otherwise."""
    try:
        yield
    except BaseException as error:
        for failure in failures:
            if failure not in getattr(error, "__notes__", ()):
                error.add_note(failure)
        raise


def _limits(
    manoeuvre: Manoeuvre, present: Mapping[str, float], drives: bool, ours: Mapping[int, int]
) -> MovementLimits:
    return MovementLimits(
        drives=drives,
        ours=ours,
        manoeuvre=manoeuvre.duration,
        still=present.get("SWP_STILL", 0.0),
        v_max=present.get("SWP_V_MAX", math.inf),
    )


def _stop_applet(error: BaseException, link: Link, settings: RunSettings) -> list[str]:
    """After Ctrl-C with the pilot's switch, stop the applet as if the switch were low. Returns failures."""
    if settings.trigger != "pilot" or not isinstance(error, KeyboardInterrupt):
        return []
    try:
        with another_stop():
            link.require("stop the applet", "MAV_CMD_DO_AUX_FUNCTION", float(SCRIPTING_1), 0.0)
    except RoverSweepError as failure:
        return [f"{failure}; throw the switch low"]
    except KeyboardInterrupt:
        return ["the rover did not confirm the order to stop the applet; throw the switch low"]
    return []


def _upload(link: Link, values: Mapping[str, float]) -> Iterator[Event]:
    for name, value in values.items():
        written = write_parameter(link, name, value)
        if written.changed:
            yield written


def _start(
    link: Link,
    controls: Controls,
    follower: Follower,
    settings: RunSettings,
    right: RightToMove,
    takeover: Takeover,
) -> Generator[Event, None, float]:
    """Arm, throw the switch and wait for the applet; returns the time of the switch [s, vehicle's clock]."""
    controls.take()
    right.watched(settings.throttle_us or 0, *takeover.declare())
    yield from _arm(link, controls, follower, settings)
    yield from follower.take()
    yield Armed(link.clock.now)
    if link.mode != MANUAL:
        yield Notice("warning", f"the rover is not in MANUAL (mode {link.mode}); the applet will not start")
    yield from follower.take()
    takeover.confirm()
    go = write_go(link)
    follower.begin()
    start = link.clock.now
    pilot = settings.trigger == "pilot"
    if pilot:
        yield SwitchWanted("high", controls.channels.switch)
    right.thrown(follower.number, go)
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
    """Arm, repeatedly while the vehicle is not ready; or wait until the pilot has armed."""
    started, reason = link.clock.now, ""
    patience = min(settings.patience, _ARMING_LIMIT) if settings.arm else settings.patience
    if not settings.arm and not link.armed:
        yield Notice("info", "waiting for the pilot to arm, in MANUAL")
    while not link.armed:
        if link.clock.now - started > patience:
            waited = f"the rover was not armed within {patience:.0f} s"
            raise LinkError(f"{waited}: {reason}" if reason else waited)
        yield from follower.take()
        if not settings.arm:
            link.receive(0.5)
            continue
        pump(link, _BEFORE_ARMING)
        try:
            controls.arm()
        except Refused as refused:
            if str(refused) != reason:
                yield Notice("info", f"{refused}; trying for {patience:.0f} s")
            reason = str(refused)
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
    if SWITCH_LOW <= pwm < 0xFFFF:
        return (
            f"{sentence}: the radio holds that channel at {pwm} us, but the applet waits until it is low "
            f"(below {SWITCH_LOW} us); throw switch {number} low and start again"
        )
    return f"{sentence} and sent no message; is scripting on (SCR_ENABLE 1)?"


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
    """Servo output (1-based) that steers; 1, ArduPilot's default, if none of 1-4 is set to steering."""
    return next((n for n in range(1, 5) if present.get(f"SERVO{n}_FUNCTION") == STEERING_FUNCTION), 1)
