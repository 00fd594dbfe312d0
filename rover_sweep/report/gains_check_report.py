"""The report of `gains --check`: what to change next, and the figures of one or two logs side by side."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

from rover_sweep.gains.check import GainFault, SpeedCheck, SteeringCheck
from rover_sweep.gains.first import FirstFeedForward
from rover_sweep.gains.gains_json import BothChecks
from rover_sweep.gains.tracking import Oscillation, Tracking
from rover_sweep.report.document import Document, Section, Sentence, Table, items, some, table_of

_LIMITS = {
    "ATC_STR_RAT_MAX": "at ATC_STR_RAT_MAX",
    "ATC_TURN_MAX_G": "at ATC_TURN_MAX_G",
    "ATC_STR_ACC_MAX": "at ATC_STR_ACC_MAX",
    "": "steering at its stops",
}
_GAINS = ("FF", "P", "I", "D")
NONE = "-"


def check_report(before: BothChecks, now: BothChecks) -> Document:
    """The checks of steering and speed with the present gains, and in the drive before, if there is one."""
    steering, speed = now
    checks: list[SteeringCheck | SpeedCheck] = [*steering, *speed]
    faults = [fault for check in checks for fault in check.findings]
    said = [f"{f.name}{_way(check)}: {f.words}" for check in checks for f in check.findings]
    skipped = [f"not checked{_way(check)}: {words}" for check in steering for words in check.skipped]
    loop = steering[0].autopilot
    notes = [f"note: {loop.assumed_words}"] if "ATC_STR_RAT_MAX" in loop.assumed else []
    return Document(
        "Gains checked",
        "",
        (Sentence(_verdict(faults, bool(skipped)), "strong"), *items([*said, *skipped, *notes])),
        (
            Section(
                "",
                some(
                    _table("Steering", [(c, _steering(c)) for c in (*before[0], *steering)], len(before[0])),
                    Sentence(_improved(before[0], steering)),
                    _table("Speed", [(c, _speed(c)) for c in (*before[1], *speed)], len(before[1])),
                ),
            ),
        ),
    )


def first_report(first: FirstFeedForward) -> Document:
    """The FF from a drive without the controller, and how to check the gains next."""
    if first.reversed_servo:
        verdict = f"Next: turn {first.reversed_servo} over: the controller would steer away from its target."
    elif first.fits:
        verdict = "FF fits. Next: drive in ACRO and check again."
    else:
        change = f"set ATC_STR_RAT_FF to {first.next:g} (now {first.now:.4g})"
        verdict = f"Next: {change}, drive in ACRO and check again."
    said = items(list(_about_first(first)))
    return Document(f"First gain from {first.name}", "", (Sentence(verdict, "strong"), *said), ())


def _about_first(first: FirstFeedForward) -> Iterator[str]:
    interval = f"{first.value:.3g} ({first.low:.3g} to {first.high:.3g})"
    yield f"ATC_STR_RAT_FF that holds a turn at {first.speed:.2g} m/s: {interval}, from the driving alone"
    if first.level != "good":
        yield "the driving shows it only roughly: `identify` with this log says why"
    if first.assumed:
        yield (
            f"the log lacks {', '.join(first.assumed)}, so the firmware's defaults were assumed; FF scales "
            "with the servo's ends: give the .BIN of the drive"
        )
    if first.reversed_servo:
        yield (
            f"a larger output of the servo turns the rover to the other side than {first.reversed_servo} "
            "says; if the stick steers to the right side in MANUAL, RC1_REVERSED hides it"
        )
    yield f"P, I and the limits were not checked: {first.why}"


def _way(check: SteeringCheck | SpeedCheck) -> str:
    return " in reverse" if check.log.reverse else ""


def _verdict(findings: Sequence[GainFault], skipped: bool) -> str:
    changes = [f for f in findings if f.parameter]
    if changes:
        first = changes[0]
        return f"Next: set {first.parameter} to {first.value:g} (now {first.now:.4g}), drive and check again."
    if findings:
        return "No parameter to change, but the rover cannot follow the target:"
    return "The gains could not be judged." if skipped else "Nothing to change."


def _improved(before: Sequence[SteeringCheck], steering: Sequence[SteeringCheck]) -> str:
    """The error after against that before; "" without a drive before."""
    if not before:
        return ""
    old, new = (c.achieved.rms / c.achieved.target_rms for c in (before[0], steering[0]))
    word = f"{old / new:.1f} times smaller" if new <= old else f"{new / old:.1f} times larger"
    return f"The error, as a share of the target, is {word} after than before."


def _table(
    title: str, columns: Sequence[tuple[SteeringCheck | SpeedCheck, Mapping[str, str]]], before: int
) -> Table:
    """A column for each check, the first `before` of the drive before; without rows that hold nothing."""
    cells = [cells for _, cells in columns]
    when = ["before: "] * before + ["after: " if before else ""] * (len(columns) - before)
    headings = [f"{of}{check.log.name}{_way(check)}" for of, (check, _) in zip(when, columns, strict=True)]
    labels = [label for label in (cells or [{}])[0] if any(c[label] != NONE for c in cells)]
    return table_of(title, ("", *headings), ((label, *(c[label] for c in cells)) for label in labels))


def _steering(check: SteeringCheck) -> dict[str, str]:
    gains, found, ff = check.autopilot.gains, check.achieved, check.feed_forward
    limits = {limit.parameter: f"{limit.seconds:.1f} s" for limit in check.limits}
    degrees = math.degrees(1.0)
    return {
        "FF, P, I, D": ", ".join(f"{getattr(gains, name.lower()):.3g}" for name in _GAINS),
        "driven": f"{check.log.seconds:.0f} s at {check.speed:.2f} m/s",
        **_tracked("", found, "deg/s", degrees),
        "FF that holds a turn": f"{ff[0]:.3g} ({ff[1]:.3g} to {ff[2]:.3g})" if ff else NONE,
        "oscillation": _swing(check.oscillation, "deg/s", degrees),
        **{label: limits.get(name, NONE) for name, label in _LIMITS.items()},
        **_tracked("by the model: ", check.predicted, "deg/s", degrees),
        **_tracked("predicted after the change: ", check.after, "deg/s", degrees),
    }


def _tracked(of: str, found: Tracking | None, unit: str, factor: float) -> dict[str, str]:
    if found is None:
        return {f"{of}{name}": NONE for name in ("error", "lag", "overshoot")}
    share = 100 * found.rms / found.target_rms if found.target_rms else math.nan
    overshoot = f"{found.overshoot:.0f} %" if math.isfinite(found.overshoot) else NONE
    return {
        f"{of}error": f"{factor * found.rms:.3g} {unit} rms ({share:.0f} %)",
        f"{of}lag": f"{found.lag:.2f} s",
        f"{of}overshoot": overshoot,
    }


def _swing(found: Oscillation | None, unit: str, factor: float) -> str:
    return f"{found.hz:.1f} Hz, {factor * found.rms:.2g} {unit} rms" if found else "none"


def _speed(check: SpeedCheck) -> dict[str, str]:
    cruise, p = check.cruise, check.log.parameters
    return {
        "P, I, D": ", ".join(f"{p.get(f'ATC_SPEED_{name}', 0.0):.3g}" for name in "PID"),
        **_tracked("", check.achieved, "m/s", 1.0),
        "CRUISE_THROTTLE needed": f"{cruise[0]:.0f} % ({cruise[1]:.0f} to {cruise[2]:.0f} %)"
        if cruise
        else NONE,
        "CRUISE_THROTTLE set": f"{p['CRUISE_THROTTLE']:.0f} %" if "CRUISE_THROTTLE" in p else NONE,
        "oscillation": _swing(check.oscillation, "m/s", 1.0),
    }
