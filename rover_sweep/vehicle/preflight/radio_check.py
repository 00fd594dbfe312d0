"""Checks of the pilot's radio (present, sticks at rest, failsafe) and of the applet's switch."""

from __future__ import annotations

from math import isnan

from firmware_params.applet_parameters import SWITCH_HIGH, SWITCH_LOW
from rover_sweep.vehicle.preflight.item import Check, Remedy
from rover_sweep.vehicle.preflight.observed import Observation
from rover_sweep.vehicle.run.controls import SCRIPTING_1

_PULSES = (800, 2200)  # us: RC_MIN_LIMIT_PWM, RC_MAX_LIMIT_PWM
_NOTICE = Remedy(
    "set FS_THR_ENABLE to 1 and FS_ACTION to 2 (Hold)", sets=(("FS_THR_ENABLE", 1.0), ("FS_ACTION", 2.0))
)
_SIX = Remedy(f"set RC6_OPTION to {SCRIPTING_1}", sets=(("RC6_OPTION", float(SCRIPTING_1)),))
_REST = 30  # us about the trim, where the channel has no dead zone


def switch_channel(observed: Observation) -> int:
    """RC channel (1-based) that starts the applet: SWP_CHAN, else the one with RCn_OPTION 300; 0: none."""
    raw = observed.parameter("SWP_CHAN")
    if raw > 0:
        return int(raw)
    return next((n for n in range(1, 17) if observed.parameter(f"RC{n}_OPTION") == SCRIPTING_1), 0)


def rc(observed: Observation) -> Check:
    """Whether the receiver gives pulses, both sticks are at rest, and a failsafe detects its loss."""
    if not observed.channels:
        sentence = "no radio: only this computer could stop the rover"
        return Check("rc", "bad", "no receiver", sentence, Remedy("switch the transmitter on", by_hand=True))
    if observed.radio is False:  # RC_CHANNELS keeps the last values (4.6.3, SIM_RC_FAIL 1)
        sentence = "the rover reports that it does not hear its radio (SYS_STATUS)"
        hand = Remedy("switch the transmitter on", by_hand=True)
        return Check("rc", "bad", "radio lost", sentence, hand)
    steering, throttle = _stick(observed, "RCMAP_ROLL", 1), _stick(observed, "RCMAP_THROTTLE", 3)
    value = f"{len(observed.channels)} channels, steering {steering[1]:.0f} us, throttle {throttle[1]:.0f} us"
    if observed.channels.get(throttle[0], 0) < observed.parameter("FS_THR_VALUE"):
        sentence = f"throttle {throttle[1]:.0f} us is below FS_THR_VALUE: the receiver lost the radio"
        return Check("rc", "bad", value, sentence, Remedy("switch the transmitter on", by_hand=True))
    for words, (number, pwm, trim, zone) in (("steering", steering), ("throttle", throttle)):
        if abs(pwm - trim) > zone:
            sentence = (
                f"the {words} stick (channel {number}) is {pwm - trim:+.0f} us off its trim of {trim:.0f} us"
            )
            return Check(
                "rc", "bad", value, sentence, Remedy("leave the sticks alone, or trim them", by_hand=True)
            )
    if not observed.parameter("FS_THR_ENABLE") > 0 or observed.parameter("FS_ACTION") == 0:
        sentence = "the rover would not react to a loss of the radio (FS_THR_ENABLE, FS_ACTION)"
        return Check("rc", "bad", value, sentence, _NOTICE)
    return Check("rc", "good", value)


def _stick(observed: Observation, mapping: str, usual: int) -> tuple[int, float, float, float]:
    """(channel, PWM [us], trim [us], largest offset from trim that counts as rest [us])."""
    mapped = observed.parameter(mapping)
    number = usual if isnan(mapped) else int(mapped)
    trim, zone = observed.parameter(f"RC{number}_TRIM"), observed.parameter(f"RC{number}_DZ")
    pwm = float((observed.channels or {}).get(number, 0))
    return number, pwm, 1500.0 if isnan(trim) else trim, max(_REST, 0.0 if isnan(zone) else zone)


def switch(observed: Observation) -> Check:
    """Whether the switch is low: the applet does not start if it is high at its first reading."""
    number = switch_channel(observed)
    if number == 0:
        sentence = "no channel starts the applet: none has option 300, and SWP_CHAN is 0"
        return Check("switch", "bad", "none", sentence, _SIX)
    pwm = (observed.channels or {}).get(number, 0)
    value = f"channel {number}: {pwm} us"
    if not _PULSES[0] <= pwm <= _PULSES[1]:
        sentence = f"channel {number} has no pulses: the position of the switch is unknown"
        hand = Remedy(f"give channel {number} a switch on the transmitter", by_hand=True)
        return Check("switch", "unknown", value, sentence, hand)
    if pwm >= SWITCH_LOW:
        where = "high" if pwm > SWITCH_HIGH else "in the middle"
        sentence = f"switch {number} is {where}; it must be low before the rover is armed"
        return Check("switch", "bad", value, sentence, Remedy(f"throw switch {number} low", by_hand=True))
    return Check("switch", "good", f"{value}, low")
