"""Checks whether the rover is ready to drive: EKF, GPS, battery, mode, armed."""

from __future__ import annotations

from math import isnan

from rover_sweep.vehicle.modes import mode_name
from rover_sweep.vehicle.preflight.item import Check, Remedy, State
from rover_sweep.vehicle.preflight.observed import Battery, Observation

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
    return Check("battery", "good", value)


def _value(b: Battery) -> str:
    words = [] if isnan(b.volts) else [f"{b.volts:.1f} V"]
    words += [] if isnan(b.remaining) else [f"{b.remaining:.0%}"]
    return ", ".join(words) or "not measured"


def mode(observed: Observation) -> Check:
    """Whether the rover is in MANUAL: the applet starts only there."""
    value = mode_name(observed.mode)
    if observed.mode == 0:
        return Check("mode", "good", value)
    sentence = f"the rover is in {value}, but the applet starts only in MANUAL"
    if observed.armed:
        return Check("mode", "bad", value, sentence, Remedy("the pilot switches to MANUAL", by_hand=True))
    return Check("mode", "bad", value, sentence, Remedy("switch to MANUAL"))


def armed(observed: Observation) -> Check:
    """Whether the rover is disarmed, so that it cannot drive off during the preparation."""
    if not observed.armed:
        return Check("armed", "good", "disarmed")
    sentence = "the rover is armed: this program does not set it up or reboot it, and it sends no logs"
    return Check("armed", "bad", "armed", sentence, Remedy("disarm"))
