"""Checks of what is on the autopilot: firmware, applet, parameters, logging."""

from __future__ import annotations

from rover_sweep.vehicle.identity import NEWEST, untried
from rover_sweep.vehicle.preflight.item import Check, Remedy
from rover_sweep.vehicle.preflight.observed import Observation
from rover_sweep.vehicle.setup.survey import SurveyedParameter

# Bits of Rover's LOG_BITMASK (Rover/defines.h, 4.6.3), and what is lost without them.
_LOG_BITS = {0: "attitude at loop rate", 2: "GPS", 7: "IMU at loop rate", 13: "steering", 14: "servo outputs"}
_FILE = 1  # bit of LOG_BACKEND_TYPE: files on the card
_USUAL = 65535  # LOG_BITMASK as ArduPilot ships it
_CARD = "how much room the card has cannot be asked over MAVLink: look at it at times"


def firmware(seen: Observation) -> Check:
    """Whether it is a version on which the applet was tried."""
    vehicle = seen.survey.vehicle
    warning = untried(vehicle)
    if warning:
        hand = Remedy(f"flash ArduRover {NEWEST[0]}.{NEWEST[1]}, or go on with care", by_hand=True)
        return Check("firmware", "doubtful", vehicle.firmware, warning, hand)
    return Check("firmware", "good", f"{vehicle.firmware} ({vehicle.git_hash})")


def parameters(seen: Observation) -> Check:
    """The shipped identification.param against the rover, and what waits for a reboot."""
    wrong = [p for p in seen.survey.parameters if not p.fits]
    total = len(seen.survey.parameters)
    if wrong:
        words = "; ".join(_differs(p) for p in wrong)
        reboot = any(p.wanted.needs_reboot for p in wrong)
        names = ", ".join(p.wanted.name for p in wrong)
        sets = tuple((p.wanted.name, p.wanted.value) for p in wrong if p.found is not None)
        remedy = Remedy(f"set {names}" + (" and reboot" if reboot else ""), reboot=reboot, sets=sets)
        return Check("parameters", "bad", f"{len(wrong)} of {total} differ", words, remedy)
    if seen.pending:
        names = ", ".join(seen.pending)
        sentence = f"{names} was set and does not count before a reboot"
        return Check("parameters", "bad", f"reboot for {names}", sentence, Remedy("reboot", reboot=True))
    return Check("parameters", "good", f"all {total} fit")


def _differs(checked: SurveyedParameter) -> str:
    if checked.found is None:
        return f"{checked.wanted.name} is not there"
    bound = "at least " if checked.wanted.at_least else ""
    return f"{checked.wanted.name} is {checked.found:.7g}, wanted {bound}{checked.wanted.value:.7g}"


def applet(seen: Observation) -> Check:
    """Whether this program's applet runs, and nothing else under its name."""
    state = seen.survey.applet
    if state.fits and state.file is None:
        return Check("applet", "doubtful", "runs, version unknown", state.sentence, _bring())
    if state.fits:
        return Check("applet", "good", f"{state.file.version if state.file else ''} runs")
    if state.runs and not state.enabled:
        return Check(
            "applet",
            "bad",
            "switched off",
            state.sentence,
            Remedy("set SWP_ENABLE to 1", sets=(("SWP_ENABLE", 1.0),)),
        )
    scripting = seen.parameter("SCR_ENABLE")
    if scripting != scripting:
        sentence = "this firmware has no Lua scripting (no SCR_ENABLE), so that no applet can run on it"
        hand = Remedy("take a board with scripting, 2 MB of flash", by_hand=True)
        return Check("applet", "bad", "no scripting", sentence, hand)
    off = scripting == 0 or "SCR_ENABLE" in seen.pending
    return Check(
        "applet", "bad", "does not run" if not state.runs else "another", state.sentence, _bring(off)
    )


def _bring(reboot: bool = False) -> Remedy:
    if reboot:
        return Remedy("switch scripting on (SCR_ENABLE 1), copy the applet there, reboot", reboot=True)
    return Remedy("copy this program's applet there and restart the scripts")


def logging(seen: Observation) -> Check:
    """Whether the autopilot will log what identification reads (LOG_BITMASK, LOG_BACKEND_TYPE, card)."""
    mask, backend = seen.parameter("LOG_BITMASK"), seen.parameter("LOG_BACKEND_TYPE")
    disarmed = "also while disarmed" if seen.parameter("LOG_DISARMED") > 0 else "from arming on"
    if mask != mask or backend != backend:
        return Check("logging", "unknown", "not told", "the rover has no LOG_BITMASK or no LOG_BACKEND_TYPE")
    lacking = [words for bit, words in _LOG_BITS.items() if not int(mask) >> bit & 1]
    told = f"LOG_BITMASK {mask:.0f}, {disarmed}"
    if lacking or not int(backend) & _FILE:
        what = f"no {', '.join(lacking)}" if lacking else f"LOG_BACKEND_TYPE {backend:.0f} writes no files"
        sentence = f"the log will have {what}" if lacking else what
        sets = (("LOG_BITMASK", float(int(mask) | _USUAL)), ("LOG_BACKEND_TYPE", float(int(backend) | _FILE)))
        remedy = Remedy("set " + " and ".join(f"{name} to {value:.0f}" for name, value in sets), sets=sets)
        return Check("logging", "bad", told, sentence, remedy)
    if seen.logging is False:
        sentence = "the firmware says that it cannot log (SYS_STATUS); is a card in it, and is it not full?"
        hand = Remedy("look after the card, then reboot", by_hand=True)
        return Check("logging", "bad", "logging failed", sentence, hand)
    return Check("logging", "good", told, _CARD)
