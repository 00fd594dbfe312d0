"""Checks of the autopilot: firmware, applet, parameters, logging."""

from __future__ import annotations

from firmware_params.applet_parameters import PARAMETERS
from rover_sweep.manoeuvre.sweep import Sweep
from rover_sweep.vehicle.identity import NEWEST, untested
from rover_sweep.vehicle.preflight.rates import streams
from rover_sweep.vehicle.preflight.read_rover import Check, Observation, Remedy
from rover_sweep.vehicle.setup import SurveyedParameter

# Bits of Rover's LOG_BITMASK (Rover/defines.h, 4.6.3), and the data that is missing without them.
_LOG_BITS = {0: "attitude at loop rate", 2: "GPS", 7: "IMU at loop rate", 13: "steering", 14: "servo outputs"}
_FILE = 1  # bit of LOG_BACKEND_TYPE: files on the card
_USUAL = 65535  # LOG_BITMASK as ArduPilot ships it
_STEERING = 26  # SERVOn_FUNCTION GroundSteering
_V_MIN = next(p.default for p in PARAMETERS if p.name == "SWP_V_MIN")  # m/s
_CARD = "MAVLink does not report the free space on the card: check the card now and then"


def firmware(observed: Observation) -> Check:
    """Whether the applet was tested on this version, on a vehicle with steered wheels."""
    vehicle = observed.survey.vehicle
    if kind := _without_steered_wheels(observed):
        sentence = (
            f"{kind}: the applet sweeps steered wheels, and only rovers with them can be identified. "
            "docs/questions.md describes what is still possible"
        )
        hand = Remedy("connect a rover with steered wheels", by_hand=True)
        return Check("firmware", "bad", "no steered wheels", sentence, hand)
    warning = untested(vehicle)
    if len(outputs := _outputs(observed, _STEERING)) > 1:
        return _several_steer(outputs, warning)
    if warning:
        hand = Remedy(f"flash ArduRover {NEWEST[0]}.{NEWEST[1]}, or continue with care", by_hand=True)
        return Check("firmware", "doubtful", vehicle.firmware, warning, hand)
    return Check("firmware", "good", f"{vehicle.firmware} ({vehicle.git_hash})")


def _without_steered_wheels(observed: Observation) -> str:
    """The vehicle and the parameters that show it, or nothing where the wheels are steered."""
    left, right = _outputs(observed, 73), _outputs(observed, 74)
    if left and right and not _outputs(observed, _STEERING):
        return f"this rover has skid steering ({left[0]}_FUNCTION is 73 and {right[0]}_FUNCTION is 74)"
    if observed.parameter("FRAME_CLASS") == 2:
        return "this is a boat (FRAME_CLASS is 2)"
    if observed.parameter("FRAME_CLASS") == 3:
        return "this is a balance bot (FRAME_CLASS is 3)"
    return ""


def _outputs(observed: Observation, function: int) -> tuple[str, ...]:
    """SERVOn of each output with a SERVOn_FUNCTION."""
    return tuple(f"SERVO{n}" for n in range(1, 17) if observed.parameter(f"SERVO{n}_FUNCTION") == function)


def _several_steer(outputs: tuple[str, ...], warning: str) -> Check:
    """Four-wheel steering, or several servos on one axle. The applet overrides the first output alone."""
    first, others = outputs[0], " and ".join(outputs[1:])
    sentence = (
        f"SERVOn_FUNCTION is {_STEERING} for {first} and {others}, as with four-wheel steering: the applet "
        f"sweeps {first} alone, and {others} stays where the stick holds it. Servos on one axle would then "
        f"work against each other{'. ' if warning else ''}{warning}"
    )
    remedy = (
        f"servos on one axle: connect them all to {first} and set the other SERVOn_FUNCTION to 0; front and "
        f"rear wheels: use only the lumped model, which then describes the rover with {others} at trim"
    )
    hand = Remedy(remedy, by_hand=True)
    return Check("firmware", "doubtful", f"{len(outputs)} outputs steer", sentence, hand)


def parameters(observed: Observation) -> Check:
    """The rover's parameters against the shipped identification.param, and those that wait for a reboot."""
    wrong = [p for p in observed.survey.parameters if not p.fits]
    total = len(observed.survey.parameters)
    if wrong:
        words = "; ".join(_differs(p) for p in wrong)
        reboot = any(p.wanted.needs_reboot for p in wrong)
        names = ", ".join(p.wanted.name for p in wrong)
        sets = tuple((p.wanted.name, p.wanted.value) for p in wrong if p.found is not None)
        remedy = Remedy(f"set {names}" + (" and reboot" if reboot else ""), reboot=reboot, sets=sets)
        return Check("parameters", "bad", f"{len(wrong)} of {total} differ", words, remedy)
    if observed.pending:
        names = ", ".join(observed.pending)
        sentence = f"{names} was set and takes effect after a reboot"
        return Check("parameters", "bad", f"reboot for {names}", sentence, Remedy("reboot", reboot=True))
    pause = observed.parameter("MOT_REV_DELAY")
    sentence = (
        f"MOT_REV_DELAY {pause:g} s: the motor pauses where its direction changes, so not in a sweep, but "
        "where the rover brakes or reverses"
    )
    return Check("parameters", "good", f"all {total} fit", sentence if pause > 0 else "")


def _differs(checked: SurveyedParameter) -> str:
    if checked.found is None:
        return f"the rover has no {checked.wanted.name}"
    bound = "at least " if checked.wanted.at_least else ""
    return f"{checked.wanted.name} is {checked.found:.7g}, wanted {bound}{checked.wanted.value:.7g}"


def applet(observed: Observation) -> Check:
    """Whether this program's version of the applet runs."""
    state = observed.survey.applet
    if state.fits and state.file is None:
        return Check("applet", "doubtful", "runs, version unknown", state.sentence, _copy())
    if state.fits and observed.parameter("SWP_V_MIN") == 0:
        sentence = (
            "SWP_V_MIN is 0, as for a test on a box: on the ground a run then begins, and goes on, at rest"
        )
        sets = (("SWP_V_MIN", _V_MIN),)
        return Check(
            "applet",
            "doubtful",
            "no least speed",
            sentence,
            Remedy(f"set SWP_V_MIN to {_V_MIN:g}", sets=sets),
        )
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
    scripting = observed.parameter("SCR_ENABLE")
    if scripting != scripting:
        sentence = "this firmware has no Lua scripting (no SCR_ENABLE), so no applet can run on it"
        hand = Remedy("use a board with scripting (2 MB of flash)", by_hand=True)
        return Check("applet", "bad", "no scripting", sentence, hand)
    off = scripting == 0 or "SCR_ENABLE" in observed.pending
    return Check("applet", "bad", "does not run" if not state.runs else "another", state.sentence, _copy(off))


def _copy(reboot: bool = False) -> Remedy:
    if reboot:
        return Remedy("enable scripting (SCR_ENABLE 1), copy the applet to the rover, reboot", reboot=True)
    return Remedy("copy this program's applet to the rover and restart the scripts")


def logging(observed: Observation) -> Check:
    """Whether the autopilot will log the data for identification (LOG_BITMASK, LOG_BACKEND_TYPE, card)."""
    mask, backend = observed.parameter("LOG_BITMASK"), observed.parameter("LOG_BACKEND_TYPE")
    disarmed = "also while disarmed" if observed.parameter("LOG_DISARMED") > 0 else "from arming on"
    if mask != mask or backend != backend:
        return Check(
            "logging", "unknown", "not reported", "the rover has no LOG_BITMASK or no LOG_BACKEND_TYPE"
        )
    lacking = [words for bit, words in _LOG_BITS.items() if not int(mask) >> bit & 1]
    value = f"LOG_BITMASK {mask:.0f}, {disarmed}"
    if lacking or not int(backend) & _FILE:
        no_files = f"LOG_BACKEND_TYPE {backend:.0f} writes no files"
        sentence = f"the log will have no {', '.join(lacking)}" if lacking else no_files
        sets = (("LOG_BITMASK", float(int(mask) | _USUAL)), ("LOG_BACKEND_TYPE", float(int(backend) | _FILE)))
        remedy = Remedy("set " + " and ".join(f"{name} to {value:.0f}" for name, value in sets), sets=sets)
        return Check("logging", "bad", value, sentence, remedy)
    if observed.logging is False:
        sentence = (
            "the firmware reports that it cannot log (SYS_STATUS); is a card in it, and is it not full?"
        )
        hand = Remedy("check the card, then reboot", by_hand=True)
        return Check("logging", "bad", "logging failed", sentence, hand)
    return Check("logging", "good", value, _CARD)


# Check of the free space on this computer's disk against the size of a run.


_BEFORE_AND_AFTER = 45.0  # s of log around the manoeuvre: standstill, run-up, 15 s after disarming
_TLOG = 12e3  # B/s at the rates of vehicle.streams: 57 B frames 200 times a second
_LOG_PER_LOOP = 250.0  # B of .BIN per main loop: 25 kB/s at 100 Hz (tests/data/ardurover-4.6.3/nominal)
_RAW = 450e3  # B/s of .BIN more with bit 19, raw IMU (LOG_BITMASK)
_FEW, _MANY = 3, 20  # runs


def run_bytes(loop_rate: float, bitmask: float) -> float:
    """Bytes of a run on this disk, .tlog and .BIN together. loop_rate [Hz]; bitmask: LOG_BITMASK."""
    log = _RAW if bitmask > 0 and int(bitmask) >> 19 & 1 else _LOG_PER_LOOP * max(loop_rate, 50.0)
    return (Sweep().duration + _BEFORE_AND_AFTER) * (_TLOG + log)


def disk(observed: Observation) -> Check:
    """Whether the session's folder has room for its runs."""
    free, folder = observed.disk
    loop = observed.parameter("SCHED_LOOP_RATE")
    each = run_bytes(50.0 if loop != loop else loop, observed.parameter("LOG_BITMASK"))
    value = f"{free / 1e9:.1f} GB free" if free >= 1e9 else f"{free / 1e6:.0f} MB free"
    runs = int(free / each)
    sentence = (
        f"room for {runs} runs of {each / 1e6:.0f} MB in {folder}"
        if runs < 1000
        else f"{each / 1e6:.0f} MB a run"
    )
    if runs < _MANY:
        hand = Remedy("free some space, or use another folder", by_hand=True)
        return Check("disk", "bad" if runs < _FEW else "doubtful", value, sentence, hand)
    return Check("disk", "good", value, sentence)


# Check that says from which recording the runs will be identified, and why.


_SLOW = 20.0  # Hz: streams up to this rate are not used for identification


def source(observed: Observation) -> Check:
    """The rover's log (.BIN) if one is written, else the telemetry (.tlog) if its streams are good.

    The log has the applet's steering and the IMU at the loop rate on one clock, without a radio in between.
    """
    log, telemetry = logging(observed), streams(observed)
    fast = {s.message for s in observed.streams if s.wanted_hz > _SLOW}
    came = [q for q in observed.quality if q.count > 2 and q.message in fast]
    rate = f"{min(q.mean_hz for q in came):.0f} Hz" if came else "nothing"
    if log.state == "good":
        loop = observed.parameter("SCHED_LOOP_RATE")
        at = "" if loop != loop else f" at {loop:.0f} Hz"
        instead = (
            f"without it the .tlog ({rate}) is good enough"
            if telemetry.state == "good"
            else f"the .tlog ({rate}) is not good enough to replace it"
        )
        sentence = f"it has steering and IMU{at} on one clock and loses nothing by radio; {instead}"
        return Check("source", "good", "the .BIN log, fetched after the runs", sentence)
    why = log.sentence or "the rover does not report whether it logs"
    if telemetry.state == "good":
        hand = Remedy("correct the logging first, or continue with the telemetry", by_hand=True)
        return Check("source", "doubtful", f"the .tlog, {rate}", f"no good log: {why}", hand)
    hand = Remedy("correct the logging or the streams: see these checks", by_hand=True)
    sentence = f"no good log: {why}; no good telemetry: {telemetry.sentence}"
    return Check("source", "bad", "neither", sentence, hand)
