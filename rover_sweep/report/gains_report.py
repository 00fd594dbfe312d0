"""The report of proposed gains of the steering: verdict, current and proposed values, margins, notes."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rover_sweep.gains.corner import HALF_WIDTH, Corner
from rover_sweep.gains.proposal import AssessedGains, Proposal, SteeringLimits
from rover_sweep.report.document import Document, Section, Sentence, Table, items, some, table_of

LARGE = 2.0  # factor of a gain from which the change is tried off the ground first


def gains_report(
    proposal: Proposal,
    limits: SteeringLimits | None,
    turns: Sequence[Corner] = (),
    half_width: float = HALF_WIDTH,
) -> Document:
    """The gains and limits of the steering as a document. turns: corners in a corridor of half_width [m]."""
    autopilot = proposal.autopilot
    notes = [f"note: {remark}" for remark in proposal.support.remarks]
    columns = proposal.now or proposal.proposed
    if autopilot.assumed and columns:
        notes.append(f"note: {autopilot.assumed_words} Give them with --now or --connect.")
    return Document(
        "Gains of the steering",
        "",
        (Sentence(_verdict(proposal), "strong"), *items([f"because {r}" for r in proposal.support.reasons])),
        (
            Section(
                "",
                some(
                    gains_table(proposal, limits) if columns else None,
                    Sentence(_origin(limits) if limits else ""),
                    Sentence(_large_changes(proposal)),
                    _corner_table(turns, half_width),
                    *items(notes),
                ),
            ),
        ),
    )


def _corner_table(turns: Sequence[Corner], half_width: float) -> Table:
    rows = (
        (
            f"{turn.speed:.2f} m/s",
            turn.gains,
            f"{math.degrees(turn.rate):.0f} deg/s",
            f"{turn.before:.1f} m",
            f"{turn.off:.2f} m",
            _corridor(turn),
        )
        for turn in turns
    )
    headings = ("", "gains", "turns at", "begins before", "off by", f"corridor of +-{half_width:g} m")
    note = (
        "The turn begins before the corner, so that the rover ends on the next leg; if it begins at the "
        "corner, it ends wide by that distance. Constant speed, without sideslip."
    )
    return table_of("A corner of 90 degrees", headings, rows, note, (0, 1, 5))


def _corridor(turn: Corner) -> str:
    if turn.leaves is None or turn.returns is None:
        return "stays in it"
    leaves, returns = (
        f"{abs(at):.1f} m {'before' if at < 0 else 'after'}" for at in (turn.leaves, turn.returns)
    )
    return f"{'swings wide' if turn.wide else 'cuts it'} from {leaves} to {returns} the corner"


def _verdict(proposal: Proposal) -> str:
    at, (low, high) = f"for {proposal.speed:.2f} m/s", proposal.speed_range
    words = {
        "gains": f"Gains {at}, valid from {low:.2f} to {high:.2f} m/s",
        "feed-forward only": f"Only the feed-forward gain can be computed {at}",
        "none": f"No gains can be computed {at}",
    }
    return f"{words[proposal.support.level]} ({proposal.found.name} model, {proposal.found.level})."


def gains_table(proposal: Proposal, limits: SteeringLimits | None) -> Table:
    """Gains, limits, margins and the predicted step of the current and of the proposed parameters."""
    unread = set(proposal.now.gains.parameters if proposal.now else ()) <= set(proposal.autopilot.assumed)
    pairs = (("firmware default" if unread else "now", proposal.now), ("proposed", proposal.proposed))
    columns = {
        heading: _column(judged, _limits(proposal, limits, heading) if limits else {})
        for heading, judged in pairs
        if judged is not None
    }
    if "now" in columns:
        for name in set(columns["now"]) & set(proposal.autopilot.assumed):
            columns["now"][name] += " (firmware default)"
    labels = next(iter(columns.values()))
    rows = ((label, *(column[label] for column in columns.values())) for label in labels)
    worst = proposal.proposed or proposal.now
    assert worst is not None
    note = (
        "Worst margins within the 90 % intervals of the model's fit and the valid speeds; gain margin at "
        f"{worst.worst_gain[1]}, phase margin at {worst.worst_phase[1]}. "
        "Steps include the firmware's limits on the target."
    )
    return table_of("Gains, margins and the predicted step", ("", *columns), rows, note)


def _limits(proposal: Proposal, limits: SteeringLimits, heading: str) -> dict[str, str]:
    """The limits of the target; the proposed lateral acceleration only where it is in the file."""
    autopilot = proposal.autopilot
    rate, lateral = math.degrees(autopilot.rate_max), f"{autopilot.lateral_g_max:.2g}"
    if heading == "proposed":
        rate = limits.rate_max
        lateral = lateral if limits.turn_g is None or limits.lowers else f"{limits.turn_g:.2g}"
    return {"ATC_STR_RAT_MAX": f"{rate:.0f} deg/s", "ATC_TURN_MAX_G": f"{lateral} g"}


def _origin(limits: SteeringLimits) -> str:
    """What the limits come from."""
    words = f"ATC_STR_RAT_MAX: 90 % of the {limits.reach:.0f} deg/s at the steering's stops."
    if limits.turn_g is None:
        return words
    confirmed = f"the runs confirm {limits.turn_g:.2f} g"
    if limits.lowers:
        confirmed += "; it is kept, because more was not tested"
    return f"{words} ATC_TURN_MAX_G: {confirmed}."


def _column(judged: AssessedGains, limits: dict[str, str]) -> dict[str, str]:
    step, margins = judged.step, judged.margins

    def margin(value: float, unit: str, form: str) -> str:
        return _number(value, unit, form, "unlimited")

    return {
        **{name: f"{value:.4g}" for name, value in judged.gains.parameters.items()},
        **limits,
        "gain margin": margin(margins.gain_db, "dB", ".1f"),
        "phase margin": margin(margins.phase_deg, "deg", ".0f"),
        "worst gain margin": margin(judged.worst_gain[0], "dB", ".1f"),
        "worst phase margin": margin(judged.worst_phase[0], "deg", ".0f"),
        "crossover frequency": _number(margins.crossover, "rad/s"),
        "bandwidth of r / target": _number(judged.bandwidth, "rad/s"),
        f"step of {math.degrees(step.size):.0f} deg/s: rise": _number(step.rise, "s"),
        "  overshoot": f"{step.overshoot:.1f} %",
        "  settling to 5 %": _number(step.settling, "s"),
        "  steering used": f"{100 * step.used:.0f} % of travel",
        "steady r / target without I": f"{100 * judged.steady:.0f} %",
    }


def _large_changes(proposal: Proposal) -> str:
    """What to do first where a gain changes by more than a factor of `LARGE`; "" where none does."""
    if proposal.now is None or proposal.proposed is None:
        return ""
    before, after = proposal.now.gains.parameters, proposal.proposed.gains.parameters
    large = [
        f"{name} {before[name]:.3g} to {value:.3g}"
        for name, value in after.items()
        if min(before.get(name, 0.0), value) > 0 and not 1 / LARGE <= value / before[name] <= LARGE
    ]
    if not large:
        return ""
    return f"Large changes: {', '.join(large)}. Try them with the wheels off the ground, then at low speed."


def _number(value: float, unit: str, form: str = ".3g", otherwise: str = "never") -> str:
    return f"{value:{form}} {unit}" if math.isfinite(value) else otherwise
