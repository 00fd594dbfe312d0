"""Checks that ask whether the autopilot would arm: conflicts of its switches, and its own checks.

ArduRover makes some checks at any time, and on request (MAV_CMD_RUN_PREARM_CHECKS); others only when somebody
arms, among them those for conflicts of switches (AP_Arming::rc_arm_checks, 4.6.3). Preflight never arms, so
it finds these conflicts in the parameters.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import isnan

from rover_sweep.vehicle.preflight.read_rover import Check, Observation, Prearm, Remedy

_ALL, _RC = 1 << 0, 1 << 6  # bits of ARMING_CHECK (AP_Arming.h, 4.6.3)
_CHANNELS = range(1, 17)
_NO_ARMING = "the autopilot does not arm"


def rc_options(observed: Observation) -> Check:
    """RCn_OPTION: no function on two channels, none on the channel of the mode switch."""
    found = {n: observed.parameter(f"RC{n}_OPTION") for n in _CHANNELS}
    if all(isnan(option) for option in found.values()):
        return Check("rc_options", "unknown", "not reported", "the rover has no RCn_OPTION")
    used = {n: int(option) for n, option in found.items() if option > 0}
    conflicts = (*_twice(used), *_on_mode_switch(used, observed.parameter("MODE_CH")))
    if not conflicts:
        return Check("rc_options", "good", f"{len(used)} with a function, no conflict")
    refuses = checks_radio(observed.parameter("ARMING_CHECK"))
    meaning = _NO_ARMING if refuses else "one switch does two things"
    sentence = f"{'; '.join(fault for fault, _ in conflicts)}: {meaning}"
    hand = Remedy("; ".join(remedy for _, remedy in conflicts), by_hand=True)
    return Check("rc_options", "bad" if refuses else "doubtful", "conflict", sentence, hand)


def _twice(used: Mapping[int, int]) -> Iterator[tuple[str, str]]:
    """(fault, remedy) of each function that several channels have. used: function by channel."""
    for function in sorted(set(used.values())):
        names = [f"RC{n}_OPTION" for n, other in used.items() if other == function]
        if len(names) > 1:
            yield (
                f"{' and '.join(names)} are {function}",
                f"keep one of {', '.join(names)}, set the others to 0",
            )


def _on_mode_switch(used: Mapping[int, int], mode: float) -> Iterator[tuple[str, str]]:
    """(fault, remedy) where the channel of the mode switch has a function. mode: MODE_CH."""
    if mode in used:
        name = f"RC{mode:.0f}_OPTION"
        fault = f"channel {mode:.0f} is the mode switch (MODE_CH) and {name} is {used[int(mode)]}"
        yield fault, f"set {name} to 0, or MODE_CH to the channel of the mode switch"


def checks_radio(arming_check: float) -> bool:
    """Whether the autopilot checks the radio and its switches when it arms. arming_check: ARMING_CHECK."""
    return isnan(arming_check) or bool(int(arming_check) & (_ALL | _RC))


def prearm(observed: Observation) -> Check:
    """The autopilot's own checks before arming (MAV_CMD_RUN_PREARM_CHECKS, SYS_STATUS)."""
    found = observed.prearm
    if found is None:
        sentence = (
            "the autopilot makes these checks only while it is disarmed"
            if observed.armed
            else "the rover does not report its checks before arming"
        )
        return Check("prearm", "unknown", "not asked" if observed.armed else "not reported", sentence)
    if found.off:
        sentence = "ARMING_CHECK is 0: the autopilot checks nothing before it arms"
        on = Remedy("set ARMING_CHECK to 1", sets=(("ARMING_CHECK", 1.0),))
        return Check("prearm", "doubtful", "switched off", sentence, on)
    if found.reasons:
        return _with_reasons(found)
    if found.passed:
        return Check("prearm", "good", "the autopilot's own checks pass")
    sentence = f"{_NO_ARMING}, and its reason did not arrive"
    hand = Remedy("run preflight again, or read the rover's messages in a ground station", by_hand=True)
    return Check("prearm", "bad", "not passed", sentence, hand)


def _with_reasons(found: Prearm) -> Check:
    reasons, many = "; ".join(found.reasons), len(found.reasons)
    hand = Remedy("; ".join(dict.fromkeys(map(_advice, found.reasons))), by_hand=True)
    if found.passed:
        sentence = f"the autopilot said a moment ago: {reasons}; now its checks pass"
        return Check("prearm", "doubtful", "changing", sentence, hand)
    return Check("prearm", "bad", f"{many} not passed", f"{_NO_ARMING}: {reasons}", hand)


# What to do for a reason, by a part of the firmware's text (AP_Arming.cpp, Rover/AP_Arming.cpp, 4.6.3).


_ADVICE = (
    ("Radio failsafe", "switch the transmitter on"),
    ("RC not calibrated", "calibrate the radio"),
    ("radio m", "calibrate the radio"),
    ("RC calibrating", "end the calibration of the radio"),
    ("safety switch", "press the safety switch"),
    (" config", "give one output SERVOn_FUNCTION 26 and one SERVOn_FUNCTION 70, and none 73 or 74"),
    ("_TRIM", "set the trim between the minimum and the maximum of that channel"),
    ("Scripting", "correct or remove that script, then restart the scripts"),
    ("ompass", "calibrate the compass, away from iron, or check its cable"),
    ("Gyros", "keep the rover still and reboot it"),
    ("Accels", "calibrate the accelerometers"),
    ("AHRS", "keep the rover still under open sky and wait"),
    ("EKF", "keep the rover still under open sky and wait"),
    ("GPS", "wait under open sky"),
    ("attery", "change or charge the battery"),
    ("Logging", "check the card, then reboot"),
    ("Mode not armable", "switch to MANUAL"),
    ("not initialised", "wait until the rover has booted"),
)


def _advice(reason: str) -> str:
    otherwise = "look this text up in ArduPilot's page 'Pre-Arm Safety Checks'"
    return next((advice for part, advice in _ADVICE if part in reason), otherwise)
