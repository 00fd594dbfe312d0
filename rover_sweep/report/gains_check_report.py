"""The report of `gains --check`: what to change next, and the figures of one or two logs side by side."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from rover_sweep.gains.check import GainFault, SpeedCheck, SteeringCheck
from rover_sweep.gains.tracking import Oscillation, Tracking
from rover_sweep.report.document import Cell, Document, Section, Sentence, Table, items, some

_LIMITS = {
    "ATC_STR_RAT_MAX": "at ATC_STR_RAT_MAX",
    "ATC_TURN_MAX_G": "at ATC_TURN_MAX_G",
    "ATC_STR_ACC_MAX": "at ATC_STR_ACC_MAX",
    "": "steering at its stops",
}
_GAINS = ("FF", "P", "I", "D")
NONE = "-"


def check_report(steering: Sequence[SteeringCheck], speed: Sequence[SpeedCheck]) -> Document:
    """The checks of one log or of two, before and after."""
    last = steering[-1]
    on_speed = [f for check in speed[-1:] for f in check.findings]
    skipped = [f"not checked: {words}" for words in last.skipped]
    notes = [f"note: {last.autopilot.assumed_words}"] if "ATC_STR_RAT_FF" in last.autopilot.assumed else []
    return Document(
        "Gains checked",
        "",
        (
            Sentence(_verdict([*last.findings, *on_speed], bool(skipped)), "strong"),
            *items([f"{f.name}: {f.words}" for f in (*last.findings, *on_speed)]),
            *items([*skipped, *notes]),
        ),
        (
            Section(
                "",
                some(
                    _table("Steering", _headings(steering), [_steering(check) for check in steering]),
                    Sentence(_improved(steering)),
                    _table("Speed", _headings(speed), [_speed(check) for check in speed]) if speed else None,
                ),
            ),
        ),
    )


def _verdict(findings: Sequence[GainFault], skipped: bool) -> str:
    changes = [f for f in findings if f.parameter]
    if changes:
        first = changes[0]
        return f"Next: set {first.parameter} to {first.value:g} (now {first.now:.4g}), drive and check again."
    if findings:
        return "No parameter to change, but the rover cannot follow the target:"
    return "The gains could not be judged." if skipped else "Nothing to change."


def _improved(steering: Sequence[SteeringCheck]) -> str:
    """The error of the last log against that of the first; "" for one log."""
    if len(steering) < 2:
        return ""
    before, after = (c.achieved.rms / c.achieved.target_rms for c in (steering[0], steering[-1]))
    word = f"{before / after:.1f} times smaller" if after <= before else f"{after / before:.1f} times larger"
    return f"The error, as a share of the target, is {word} after than before."


def _headings(checks: Sequence[SteeringCheck] | Sequence[SpeedCheck]) -> tuple[str, ...]:
    names = [check.log.name for check in checks]
    if len(names) == 2:
        return f"before: {names[0]}", f"after: {names[1]}"
    return tuple(names)


def _table(title: str, headings: Sequence[str], columns: Sequence[Mapping[str, str]]) -> Table:
    """Rows in which every column has nothing are left out."""
    labels = [label for label in columns[0] if any(column[label] != NONE for column in columns)]
    rows = tuple((Cell(label), *(Cell(column[label]) for column in columns)) for label in labels)
    return Table(title, ("", *headings), rows)


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
