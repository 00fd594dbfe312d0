"""One run on the vehicle, as a generator of events.

Nothing arms or moves unless `RunSettings` says so. However the run ends (done, exception, Ctrl-C, the
generator closed, the link lost) the switch goes low, throttle and steering go to trim, the rover is
disarmed if this program armed it, and the override is released. The pilot's controls are not touched; only
Ctrl-C also stops the applet. While this program moves the rover, `RightToMove` decides at every pass of the
link whether it still may; once it may not, the run is over.

Stop paths on the vehicle, which need no laptop: the pilot throws the switch low, disarms or changes the mode;
RC_OVERRIDE_TIME after our last override (1 s if we drive) the radio has the switch again and the applet
stops; the applet stops on RC loss, GCS loss (SWP_GCS) and on its own limits; its servo override has a
timeout, so that even after a script error the pilot steers again within a fraction of a second. The applet
starts only one run for each new value of SWP_GO, which is written before each run.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Iterator, Mapping
from pathlib import Path

from firmware_params.applet_parameters import SWITCH_LOW
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
_START_LIMIT = 10.0  # s of the vehicle's clock from our switch to the applet's first state
_ARMING_LIMIT = 60.0  # s for which we try to arm: a consent does not last for ever
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
    """Upload, arm and trigger as far as `settings` allow, follow, and release. Also returns the last event.

    LinkError if the vehicle refuses, if the applet does not start, or if the link is lost for good; a
    manoeuvre that ended early is a `RunFinished` with completed False. The exception that ends a run has
    notes on all that could not be released.
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
                unstopped, failed = _stop_applet(error, link, settings), controls.let_go()
                for failure in [*unstopped, *lapse.put_back(right.heard), *failed]:
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


def _stop_applet(error: BaseException, link: Link, settings: RunSettings) -> list[str]:
    """After Ctrl-C with the pilot's switch, stop the applet as if the switch were low. Returns failures."""
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
    """Arm, throw the switch and wait for the applet; returns the time of the switch [s, vehicle's clock]."""
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
    return next((n for n in range(1, 5) if present.get(f"SERVO{n}_FUNCTION") == _STEERING_FUNCTION), 1)
