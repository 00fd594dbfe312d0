"""Checks whether the rover is ready to drive: EKF, GPS, battery, mode, armed."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Mapping
from dataclasses import replace
from math import isnan
from pathlib import Path

import numpy as np

from firmware_params.applet_parameters import applet_path
from firmware_params.param_files import compare, read, shipped
from rover_sweep.errors import LinkError, UsageError
from rover_sweep.logs.readers.tlog import STAMP, parse_tlog
from rover_sweep.vehicle.events import Event, Notice, Rebooting
from rover_sweep.vehicle.identity import identify_vehicle, mode_name
from rover_sweep.vehicle.link.inbox import ADVICE, BadLink
from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.parameters import read_present, write_parameter
from rover_sweep.vehicle.preflight import arming, onboard, rates
from rover_sweep.vehicle.preflight.read_rover import (
    Battery,
    Check,
    ClockComparison,
    Observation,
    Remedy,
    State,
    estimate,
    look,
)
from rover_sweep.vehicle.run.controls import MANUAL
from rover_sweep.vehicle.setup import (
    SCRIPTS_START,
    await_applet,
    copied_applet,
    forget,
    note,
    reboot,
    refuse_armed,
    waiting,
)

# EKF_STATUS_FLAGS (ardupilotmega dialect): reliable speed and position need velocity and position
_ATTITUDE, _VELOCITY, _POSITION, _CONSTANT = 1, 2, 16, 128
_WAIT = Remedy("wait under open sky, then check again", by_hand=True)
_FIX = {0: "no GPS", 1: "no fix", 2: "2D", 3: "3D", 4: "DGPS", 5: "RTK float", 6: "RTK fixed"}
_SATELLITES, _HDOP = 6, 2.0
_LOW, _EMPTY = 0.3, 0.15  # share of the battery, if the vehicle has no voltage limit


def gps(observed: Observation) -> Check:
    """Fix, satellites, dilution of precision."""
    g = observed.gps
    if g is None:
        return Check("gps", "unknown", "not reported", "the rover sends no GPS_RAW_INT", _WAIT)
    value = f"{_FIX.get(g.fix, f'fix {g.fix}')}, {g.satellites} satellites"
    value += "" if isnan(g.hdop) else f", HDOP {g.hdop:.1f}"
    if g.fix < 3:
        return Check("gps", "bad", value, "without a 3D fix there is no speed", _WAIT)
    if g.satellites < _SATELLITES or g.hdop > _HDOP:
        return Check("gps", "doubtful", value, "the speed may drift, because it comes from the GPS", _WAIT)
    return Check("gps", "good", value)


def ekf(observed: Observation) -> Check:
    """Whether attitude, velocity and position are estimated, and with which variance."""
    e = observed.estimator
    if e is None:
        return Check("ekf", "unknown", "not reported", "the rover sends no EKF_STATUS_REPORT", _WAIT)
    lacking = [
        words
        for flag, words in ((_ATTITUDE, "attitude"), (_VELOCITY, "velocity"), (_POSITION, "position"))
        if not e.flags & flag
    ]
    value = f"flags {e.flags}, variance {e.worst:.2f}"
    if lacking or e.flags & _CONSTANT:
        sentence = (
            f"the EKF has no {' and no '.join(lacking or ['velocity'])} yet; ArduPilot arms before it has"
        )
        return Check("ekf", "bad", value, sentence, _WAIT)
    if e.worst > 0.5:
        sentence = "the EKF almost rejects its sensors (a variance is above 0.5; the limit is 1)"
        hand = Remedy("leave the rover at rest for a while; check compass and GPS", by_hand=True)
        return Check("ekf", "bad" if e.worst > 0.8 else "doubtful", value, sentence, hand)
    return Check("ekf", "good", value)


def battery(observed: Observation) -> Check:
    """Voltage against the vehicle's limits (BATT_CRT_VOLT, BATT_LOW_VOLT), else the remaining share."""
    b = observed.battery or Battery()
    value = _value(b)
    if isnan(b.volts) and isnan(b.remaining):
        hand = Remedy("measure it with a meter, or set BATT_MONITOR", by_hand=True)
        return Check("battery", "unknown", value, "the rover does not measure its battery", hand)
    change = Remedy("change or charge it", by_hand=True)
    for name in ("BATT_CRT_VOLT", "BATT_LOW_VOLT", "BATT_ARM_VOLT"):
        limit = observed.parameter(name)
        if limit > 0 and b.volts <= limit:
            return Check("battery", "bad", value, f"at or below {name} {limit:g} V", change)
    if b.remaining < _LOW:
        state: State = "bad" if b.remaining < _EMPTY else "doubtful"
        return Check(
            "battery",
            state,
            value,
            "it may run empty, and the servo becomes slower as the voltage drops",
            change,
        )
    if not observed.parameter("BATT_LOW_VOLT") > 0 and isnan(b.remaining):
        return Check(
            "battery",
            "unknown",
            value,
            "the rover has no BATT_LOW_VOLT, so it is unknown whether this is low",
        )
    if (watts := observed.parameter("BATT_WATT_MAX")) > 0:
        sentence = (
            f"BATT_WATT_MAX {watts:g} W lowers the throttle where the motor takes more, so the speed of a "
            "run may fall. A throttle sweep writes the motor's output itself: that limit does not act in it"
        )
        hand = Remedy("drive below the limit, or set BATT_WATT_MAX to 0 for the runs", by_hand=True)
        return Check("battery", "doubtful", value, sentence, hand)
    return Check("battery", "good", value)


def _value(b: Battery) -> str:
    words = [] if isnan(b.volts) else [f"{b.volts:.1f} V"]
    words += [] if isnan(b.remaining) else [f"{b.remaining:.0%}"]
    return ", ".join(words) or "not measured"


# ArduPilot reads the mode switch only when it moves (RC_Channel::read_mode_switch, 4.6.3), so a switch that
# is in MANUAL already leaves HOLD only after it was in another position. The sticks act at once in MANUAL.
_TAKE_BACK = "centre the sticks, then turn the mode switch to another position and back to MANUAL"


def mode(observed: Observation) -> Check:
    """Whether the rover is in MANUAL: the applet starts only there."""
    value = mode_name(observed.mode)
    if observed.mode == 0:
        return Check("mode", "good", value)
    sentence = f"the rover is in {value}, but the applet starts only in MANUAL"
    if observed.armed:
        return Check("mode", "bad", value, sentence, Remedy(_TAKE_BACK, by_hand=True))
    return Check("mode", "bad", value, sentence, Remedy("switch to MANUAL"))


def armed(observed: Observation) -> Check:
    """Whether the rover is disarmed, so that it cannot drive off during the preparation."""
    if not observed.armed:
        return Check("armed", "good", "disarmed")
    sentence = "the rover is armed: this program does not set it up or reboot it, and it sends no logs"
    held = (
        "disarm"
        if observed.mode == MANUAL
        else f"disarm; to drive it from {mode_name(observed.mode)}: {_TAKE_BACK}"
    )
    return Check("armed", "bad", "armed", sentence, Remedy(held))


# The remedies of the checks, carried out on the vehicle.


Waits = Generator[Event, None, tuple[str, ...]]  # yields events, returns the names that wait for a reboot
_SCRIPTING = ("SCR_ENABLE", "SCR_HEAP_SIZE")
_NEED_REBOOT = frozenset({"SCR_ENABLE", "SCR_HEAP_SIZE", "SCHED_LOOP_RATE"})


def remedy(link: Link, check: Check, may_reboot: bool, folder: Path | None = None) -> Iterator[Event]:
    """Carry out the remedy of `check`; run `preflight` again to see whether it helped.

    folder: that of the preflight; by default the folder that the link records into. UsageError if only a
    person can do it, LinkError if the vehicle refuses.
    """
    folder = folder or link.tlog.parent
    if check.remedy is None:
        raise UsageError(f"this program has no remedy for {check.name} ({check.seen})")
    if check.remedy.by_hand:
        raise UsageError(f"{check.name} can only be corrected by hand: {check.remedy.words}")
    if check.name == "armed":
        link.require("disarm", "MAV_CMD_COMPONENT_ARM_DISARM", 0.0)
        link.wait_for("HEARTBEAT", 3.0, lambda _: not link.armed)
        yield Notice("info", "disarmed")
        return
    refuse_armed(link)
    vehicle = identify_vehicle(link)
    boots = read_present(link, ["STAT_BOOTCNT"]).get("STAT_BOOTCNT", 0.0)
    sets = check.remedy.sets
    deed = None if sets else _DEEDS.get(check.name)
    waits = (yield from _set(link, dict(sets))) if deed is None else (yield from deed(link))
    if waits:
        note(folder, vehicle, boots, waits)
    because = waiting(folder, vehicle, boots)
    if not because or not check.remedy.reboot:
        return
    if not may_reboot:
        yield Notice("warning", f"{', '.join(because)} will take effect after a reboot")
        return
    yield Rebooting(because)
    reboot(link)
    forget(folder)
    if read_present(link, ["SCR_ENABLE"]).get("SCR_ENABLE") == 1:
        await_applet(link, SCRIPTS_START)


def _set(link: Link, values: Mapping[str, float]) -> Waits:
    waits = []
    for name, value in values.items():
        written = write_parameter(link, name, value)
        if written.changed:
            yield replace(written, reboot=name in _NEED_REBOOT)
            waits += [name] if name in _NEED_REBOOT else []
    return tuple(waits)


def _applet(link: Link) -> Waits:
    """Copy the applet and start it; it waits for a reboot if scripting does."""
    wanted = [p for p in read(shipped("identification")) if p.name in _SCRIPTING]
    differences = compare(read_present(link, _SCRIPTING), wanted)
    waits = yield from _set(link, {d.name: d.wanted for d in differences if d.found is not None})
    because = yield from copied_applet(link, applet_path())
    return waits or ((because,) if because else ())


def _manual(link: Link) -> Waits:
    link.require("switch to MANUAL", "MAV_CMD_DO_SET_MODE", 1.0, float(MANUAL))
    link.wait_for("HEARTBEAT", 3.0, lambda _: link.mode == MANUAL)
    yield Notice("info", "the rover is in MANUAL")
    return ()


_DEEDS: Mapping[str, Callable[[Link], Waits]] = {"applet": _applet, "mode": _manual}


# The two clocks of a .tlog compared: arrival at this computer, and the vehicle's clock in the messages.


_MADE = "ATTITUDE"  # in milliseconds since boot; the most frequent message whose time does not wrap


def arrival_clock(tlog: Path, span: tuple[float, float]) -> ClockComparison | None:
    """Compare the clocks over `span` (start, end) [s of the vehicle's clock]; None if too few messages.

    The offset is this computer's UTC [s since 1970] minus the vehicle's time since boot [s].
    """
    data = tlog.read_bytes()
    frames = parse_tlog(data, frozenset({_MADE})).messages.get(_MADE)
    if frames is None:
        return None
    made = frames.rows["time_boot_ms"].astype(float) * 1e-3
    stamps = np.frombuffer(data, np.uint8)[(frames.order - STAMP)[:, None] + np.arange(STAMP)]
    came = stamps.view(">u8")[:, 0].astype(float) * 1e-6
    inside = (made >= span[0]) & (made <= span[1])
    return estimate(tuple(zip(made[inside].tolist(), came[inside].tolist(), strict=True)))


# `preflight`: all checks before a run. `remedy`: correct what one check found.
#
#     checks = preflight(link, folder)
#     for event in remedy(link, checks[1], may_reboot=True): ...
#
# `preflight` changes nothing on the vehicle. `remedy` moves and arms nothing. On an armed rover it only
# disarms. It reboots only with may_reboot=True; otherwise it sets the parameters, notes that they wait for a
# reboot (`setup.note`), and the next preflight in that folder asks for the reboot.


_IN_ORDER = (
    *(armed, onboard.firmware, onboard.parameters, onboard.applet),
    *(rates.loop_rate, rates.filters, rates.link, rates.streams, rates.clock),
    *(onboard.logging, onboard.source, onboard.disk),
    *(battery, gps, ekf, rates.rc, rates.switch, arming.rc_options, mode, arming.prearm),
)
NAMES = tuple(check.__name__ for check in _IN_ORDER)
"""Names of all checks, in the order in which to correct them."""


def preflight(link: Link, folder: Path, w_max: float | None = None) -> tuple[Check, ...]:
    """All checks, in the order in which to correct them.

    folder: where runs will be recorded. w_max: top frequency of the planned sweep [rad/s]; if not given, the
    applet's (SWP_WMAX). An unsupported vehicle gets only the check `firmware`, a link that is too poor to
    conclude anything only the check `link`. LinkError when the link is lost.
    """
    try:
        return all_checks(look(link, folder, w_max)) if (other := _other(link)) is None else (other,)
    except BadLink as error:
        return (Check("link", "bad", "too poor", str(error), Remedy(ADVICE, by_hand=True)),)


def _other(link: Link) -> Check | None:
    """The check `firmware` for an unsupported vehicle; None for an ArduPilot Rover."""
    try:
        identify_vehicle(link)
    except BadLink:
        raise
    except LinkError as error:
        link.receive(1.0)  # raises if the link is gone
        hand = Remedy("connect an ArduPilot Rover", by_hand=True)
        return Check("firmware", "bad", "not usable", str(error), hand)
    return None


def all_checks(observed: Observation) -> tuple[Check, ...]:
    """All checks on observed values. Pure."""
    return tuple(check(observed) for check in _IN_ORDER)
