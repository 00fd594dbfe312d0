"""Corrects the channels of a log that others contradict, or says that they contradict each other.

What two others contradict is corrected. What only one other contradicts stays, and lowers the grade.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from math import log as natural_log

import numpy as np

from rover_sweep.data.recording import Note
from rover_sweep.logs.heading import HeadingError, heading_error
from rover_sweep.logs.log import Contradiction, Log, are_different, disagreement
from rover_sweep.logs.redundant_channels import channel_relations, steering_share
from rover_sweep.quality.redundant import DECIDED, ChannelFault, ChannelRelation, FaultSet, explanations
from rover_sweep.quality.relations import stretched

CLOCK = "clock"
CONTRADICTED = "contradiction"  # fault of a run
FOLLOWS = 0.6  # share of the yaw rate, from which a steering moves the rover
DOUBT = 0.5  # probability that nothing is wrong, below which a log is said to contradict itself
SURE_SPEED = 0.03  # sd of the logarithm of the speed's scale; with more, a number is not sure to 10 %

# Priors: rough shares of the public reports on rovers that were tried, where speeds and headings were wrong
# more often than receivers and gyros. Alone against each other, none of them is likely enough to be decided.
FAULTS = (
    ChannelFault(
        "speed scale",
        "speed",
        0.03,
        scaled=("speed",),
        says="the speed is {factor:.3g} times the true one",
        remedy="check what the estimator takes its velocity from: wheel radius (WENC_RADIUS), counts per "
        "turn (WENC_CPR), or its sources (EK3_SRC1_VELXY)",
    ),
    ChannelFault(
        "wheel radius",
        "speed",
        0.03,
        scaled=("speed", "wheel_speed"),
        says="the wheel radius is wrong: the speed is {factor:.3g} times the true one",
        remedy="set WENC_RADIUS, or the counts per turn (WENC_CPR)",
    ),
    ChannelFault("wheel speed", "wheel_speed", 0.03, scaled=("wheel_speed",)),
    ChannelFault("scale of the positions", "path_speed", 0.01, scaled=("path_speed",)),
    ChannelFault("GPS speed", "gps_speed", 0.003, scaled=("gps_speed",)),
    ChannelFault(
        "gyro scale", "r", 0.002, scaled=("r",), says="the gyro reads {factor:.3g} times the yaw rate"
    ),
    ChannelFault("second gyro scale", "r2", 0.01, scaled=("r2",)),
    ChannelFault("second gyro sign", "r2", 0.005, turned=("r2",)),
    ChannelFault("accelerometer scale", "ay", 0.01, scaled=("ay",)),
    ChannelFault("scale of the heading's rate", "psi", 0.002, scaled=("psi",)),
    ChannelFault("scale of the course's rate", "course", 0.002, scaled=("course",)),
    ChannelFault(CLOCK, CLOCK, 0.02, scaled=("psi", "course")),
    ChannelFault("gyro sign", "r", 0.005, turned=("r",), says="the gyro is reversed"),
    ChannelFault(
        "IMU upside down",
        "r",
        0.02,
        turned=("r", "r2", "ay"),
        says="the IMU is upside down: yaw rate and a_y are reversed",
        remedy="set AHRS_ORIENTATION",
    ),
    ChannelFault(
        "accelerometer sign",
        "ay",
        0.005,
        turned=("ay",),
        says="a_y is reversed",
        remedy="check AHRS_ORIENTATION",
    ),
    ChannelFault(
        "compass backwards",
        "heading",
        0.03,
        turned=("heading",),
        says="the compass is backwards: the heading points 180 deg from where the rover goes",
        remedy="set COMPASS_ORIENT, or turn the compass",
    ),
    ChannelFault("sign of the heading's rate", "psi", 0.002, turned=("psi",)),
    ChannelFault("sign of the course's rate", "course", 0.001, turned=("course",)),
    ChannelFault(
        "throttle direction",
        "throttle",
        0.02,
        turned=("throttle",),
        says="the throttle pushes against the way the rover goes",
        remedy="check SERVOn_REVERSED of the throttle",
    ),
)


def cross_checked(log: Log) -> Log:
    """The log with its wrong channels corrected where others decide, with `contradictions` and notes."""
    if log.contradictions:
        return log
    if (error := heading_error(log)) is not None:
        log = _with_heading(log, error)
    log = replace(log, contradictions=(*log.contradictions, *_of_steering(log)))
    relations = channel_relations(log)
    if relations:
        log = _with_explanation(log, relations, explanations(relations, FAULTS))
    return replace(log, notes=(*log.notes, *(_note(c) for c in log.contradictions if c.channel != CLOCK)))


def _of_steering(log: Log) -> Iterator[Contradiction]:
    """Two records of the steering that are not of one output; the yaw rate decides which moves the rover."""
    for other in log.steering[1:]:
        first = log.steering[0]
        difference, spread = disagreement(other, first)
        if not are_different(difference, spread):
            continue
        shares = [steering_share(log, one) for one in (first, other)]
        words = (
            f"{first.source} and {other.source} differ by {difference:.0f} {first.unit} (rms): the yaw rate "
            f"follows them to {100 * shares[0]:.0f} % and {100 * shares[1]:.0f} %"
        )
        decided = shares[0] > FOLLOWS > 2 * shares[1]
        done = f"{first.source} is used" if decided else "which of them moves the wheels is not certain"
        yield Contradiction("steering", decided, f"{words}; {done}")


def _with_heading(log: Log, error: HeadingError) -> Log:
    """The log with its heading corrected by the velocity, which a rover drives along its heading."""
    signals = dict(log.signals)
    speed, left, psi = (signals[name] for name in ("speed", "vy", "psi"))
    t = speed.t
    velocity = (speed.x + 1j * left.on(t)) * np.exp(1j * error.at(t))
    signals |= {
        "speed": replace(speed, x=velocity.real),
        "vy": replace(left, t=t, x=velocity.imag),
        "psi": replace(psi, x=psi.x - error.at(psi.t)),
    }
    if error.jumps:
        shown = " and ".join(f"{abs(np.degrees(change)):.0f} deg at {at:.1f} s" for at, change in error.jumps)
        words = (
            f"the heading ({psi.source}) jumps by {shown} and neither the gyro ({signals['r'].source}) nor "
            "the course over ground does: it was corrected by these; look for a lost GPS yaw, a disturbed "
            "compass or a reset of the estimator"
        )
    else:
        words = (
            f"the heading ({psi.source}) points {abs(np.degrees(error.aside)):.0f} deg aside of the course "
            "over ground, and a rover drives along its heading: it was corrected; calibrate the compass"
        )
    found = Contradiction("heading", True, words)
    return replace(log, signals=signals, contradictions=(*log.contradictions, found))


def _with_explanation(log: Log, relations: Sequence[ChannelRelation], found: Sequence[FaultSet]) -> Log:
    """The log with what the best explanation says, corrected if it is certain enough."""
    best, right = found[0], sum(one.probability for one in found if not one.faults)
    if not best.faults or right > DOUBT:
        return log
    if clock := next((fault for fault in best.faults if fault.channel == CLOCK), None):
        words = stretched(1 / best.scales["psi"][0], _by(log, relations, [clock])).text
        said = (Contradiction(CLOCK, False, words),)
    elif best.probability < DECIDED:
        said = (_undecided(log, relations, found),)
    else:
        sd = best.scales.get("speed", (1.0, 0.0))[1]
        said = tuple(
            Contradiction(f.channel, True, _decided(log, f, best, relations), sd * (f.channel == "speed"))
            for f in best.faults
        )
        log = _corrected(log, best)
    return replace(log, contradictions=(*log.contradictions, *said))


def _corrected(log: Log, best: FaultSet) -> Log:
    """The log with the signs of yaw rate, a_y and velocity and the scales of yaw rate and speed set right."""
    signals = dict(log.signals)
    factors = dict.fromkeys({"r", "ay"} & best.turned, -1.0)
    if "heading" in best.turned:
        factors |= {"speed": -1.0, "vy": -1.0}
        if "psi" in signals:
            signals["psi"] = replace(signals["psi"], x=signals["psi"].x + np.pi)
    for channel, of in (("r", ("r",)), ("speed", ("speed", "vy"))):
        if channel in best.scales:
            factors |= {name: factors.get(name, 1.0) / best.scales[channel][0] for name in of}
    for name in factors.keys() & signals.keys():
        signals[name] = replace(signals[name], x=factors[name] * signals[name].x)
    return replace(log, signals=signals)


def _note(one: Contradiction) -> Note:
    """Of a run: a fault where its speed stays in doubt. Gyro and a_y are judged by `quality.relations`."""
    sure = one.decided and one.speed_sd <= SURE_SPEED
    doubt = not sure and one.channel in ("speed", "heading")
    return Note("warning", one.text, CONTRADICTED if doubt else "", ("speed",) if doubt else ())


def _decided(log: Log, fault: ChannelFault, best: FaultSet, relations: Sequence[ChannelRelation]) -> str:
    """What is wrong, by which relations, and what was done."""
    factor = best.scales.get(fault.channel, (1.0, 0.0))[0]
    what = fault.says.format(factor=factor) or f"the {fault.name} is wrong"
    used = {"r", "speed"} & {*fault.scaled} or {"r", "ay", "heading"} & {*fault.turned}
    done = "; it was corrected" if used else "; it is not used"
    autopilot = bool(log.parameters or log.marks)  # whose parameters the remedies name
    remedy = f": {fault.remedy}" if fault.remedy and autopilot else ""
    return f"{what} ({_by(log, relations, [fault])}){done}{remedy}"


def _by(log: Log, relations: Sequence[ChannelRelation], faults: Sequence[ChannelFault]) -> str:
    """The relations that speak for some of the faults, in words."""
    spoken = (one for one in relations if any(_speaks(one, fault) for fault in faults))
    return "; ".join(dict.fromkeys(_evidence(log, one) for one in spoken))


def _undecided(log: Log, relations: Sequence[ChannelRelation], found: Sequence[FaultSet]) -> Contradiction:
    """What may be wrong, where the log does not say which."""
    likely = [one for one in found if one.faults and one.probability > 0.1 * found[0].probability]
    faults = list(dict.fromkeys(fault for one in likely for fault in one.faults))
    by = _by(log, relations, faults)
    names = " or ".join(fault.name for fault in faults)
    squares = sum(
        one.probability * (natural_log(factor) ** 2 + sd**2)
        for one in found
        for factor, sd in [one.scales.get("speed", (1.0, 0.0))]
    )
    turned = any(one.turned & {"r", "heading"} for one in likely)
    words = f"channels contradict each other: {by}; which is wrong is not certain ({names})"
    return Contradiction(faults[0].channel, False, words, float(np.sqrt(squares)), turned)


def _speaks(one: ChannelRelation, fault: ChannelFault) -> bool:
    """Whether a relation has a channel of the fault and is not as in a correct recording."""
    off = one.exponents and abs(natural_log(one.ratio)) > 2 * one.sd
    return bool(
        (set(one.exponents) & set(fault.scaled) and off)
        or (set(one.signs) & set(fault.turned) and one.sign < 0)
    )


def _evidence(log: Log, one: ChannelRelation) -> str:
    """A relation in words."""
    s, w = log.signals, log.witnesses
    ratio = one.ratio * (one.sign or 1)
    match one.name:
        case "gps_speed" | "wheel_speed" | "path_speed":
            return f"{s['speed'].source} is {ratio:.3g} times {w[one.name].source}"
        case "psi":
            return f"{s['psi'].source} turns {ratio:.3g} times as fast as {s['r'].source}"
        case "course":
            return f"the course over ground turns {ratio:.3g} times as fast as {s['r'].source}"
        case "r2":
            return f"{w['r2'].source} is {ratio:.3g} times {s['r'].source}"
        case "force":
            return f"a_y is {ratio:.3g} times V r"
    return "the velocity points against the heading while the throttle pushes ahead"
