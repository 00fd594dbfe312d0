"""Checks of whether the rover is ready to be driven: EKF, GPS, battery, mode, armed."""

from __future__ import annotations

from math import isnan

from rover_sweep.vehicle.preflight.item import Check, Remedy, State
from rover_sweep.vehicle.preflight.observed import Battery, Observation

# EKF_STATUS_FLAGS (ardupilotmega dialect); both are needed for speed and place that can be trusted
_ATTITUDE, _VELOCITY, _POSITION, _CONSTANT = 1, 2, 16, 128
_WAIT = Remedy("wait under open sky, and look again", by_hand=True)
_FIX = {0: "no GPS", 1: "no fix", 2: "2D", 3: "3D", 4: "DGPS", 5: "RTK float", 6: "RTK fixed"}
_SATELLITES, _HDOP = 6, 2.0
_LOW, _EMPTY = 0.3, 0.15  # of the battery, where the vehicle has no voltage of its own for it
_MODES = {
    0: "MANUAL",
    1: "ACRO",
    3: "STEERING",
    4: "HOLD",
    5: "LOITER",
    6: "FOLLOW",
    7: "SIMPLE",
    8: "DOCK",
    9: "CIRCLE",
    10: "AUTO",
    11: "RTL",
    12: "SMART_RTL",
    15: "GUIDED",
    16: "INITIALISING",
}


def mode_name(mode: int) -> str:
    """Rover's custom_mode as a word (Rover/mode.h, 4.6.3)."""
    return _MODES.get(mode, f"mode {mode}")


def gps(seen: Observation) -> Check:
    """Fix, satellites, dilution."""
    g = seen.gps
    if g is None:
        return Check("gps", "unknown", "not told", "the rover sends no GPS_RAW_INT", _WAIT)
    told = f"{_FIX.get(g.fix, f'fix {g.fix}')}, {g.satellites} satellites"
    told += "" if isnan(g.hdop) else f", HDOP {g.hdop:.1f}"
    if g.fix < 3:
        return Check("gps", "bad", told, "without a fix in three dimensions there is no speed", _WAIT)
    if g.satellites < _SATELLITES or g.hdop > _HDOP:
        return Check("gps", "doubtful", told, "the speed may wander: it comes from the GPS", _WAIT)
    return Check("gps", "good", told)


def ekf(seen: Observation) -> Check:
    """Whether attitude, velocity and place are estimated, and by how much the estimator doubts itself."""
    e = seen.estimator
    if e is None:
        return Check("ekf", "unknown", "not told", "the rover sends no EKF_STATUS_REPORT", _WAIT)
    lacking = [
        words
        for flag, words in ((_ATTITUDE, "attitude"), (_VELOCITY, "velocity"), (_POSITION, "position"))
        if not e.flags & flag
    ]
    told = f"flags {e.flags}, variance {e.worst:.2f}"
    if lacking or e.flags & _CONSTANT:
        sentence = (
            f"the EKF has no {' and no '.join(lacking or ['velocity'])} yet; arming is possible before that"
        )
        return Check("ekf", "bad", told, sentence, _WAIT)
    if e.worst > 0.5:
        sentence = "the EKF hardly believes its sensors (a variance over 0.5; 1 is the limit)"
        hand = Remedy("let it stand still for a while; look after compass and GPS", by_hand=True)
        return Check("ekf", "bad" if e.worst > 0.8 else "doubtful", told, sentence, hand)
    return Check("ekf", "good", told)


def battery(seen: Observation) -> Check:
    """Volts against the vehicle's own limits (BATT_CRT_VOLT, BATT_LOW_VOLT), else what it says remains."""
    b = seen.battery or Battery()
    told = _told(b)
    if isnan(b.volts) and isnan(b.remaining):
        hand = Remedy("measure it with a meter, or set BATT_MONITOR", by_hand=True)
        return Check("battery", "unknown", told, "the rover does not measure its battery", hand)
    change = Remedy("change or charge it", by_hand=True)
    for name in ("BATT_CRT_VOLT", "BATT_LOW_VOLT", "BATT_ARM_VOLT"):
        limit = seen.parameter(name)
        if limit > 0 and b.volts <= limit:
            return Check("battery", "bad", told, f"at or below {name} {limit:g} V", change)
    if b.remaining < _LOW:
        state: State = "bad" if b.remaining < _EMPTY else "doubtful"
        return Check("battery", state, told, "it may not last, and the servo slows as it sags", change)
    if not seen.parameter("BATT_LOW_VOLT") > 0 and isnan(b.remaining):
        return Check(
            "battery", "unknown", told, "the rover has no BATT_LOW_VOLT: whether this is low is not known"
        )
    return Check("battery", "good", told)


def _told(b: Battery) -> str:
    words = [] if isnan(b.volts) else [f"{b.volts:.1f} V"]
    words += [] if isnan(b.remaining) else [f"{b.remaining:.0%}"]
    return ", ".join(words) or "not measured"


def mode(seen: Observation) -> Check:
    """The applet starts in MANUAL only."""
    told = mode_name(seen.mode)
    if seen.mode == 0:
        return Check("mode", "good", told)
    sentence = f"the rover is in {told}, and the applet starts in MANUAL only"
    if seen.armed:
        return Check("mode", "bad", told, sentence, Remedy("the pilot goes into MANUAL", by_hand=True))
    return Check("mode", "bad", told, sentence, Remedy("go into MANUAL"))


def armed(seen: Observation) -> Check:
    """Preparation belongs to a rover that cannot drive off."""
    if not seen.armed:
        return Check("armed", "good", "disarmed")
    sentence = "the rover is armed: it is neither set up nor rebooted so, and gives no logs"
    return Check("armed", "bad", "armed", sentence, Remedy("disarm"))
