"""Current and proposed gains on the terminal."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from rover_sweep.data.results import Quantity
from rover_sweep.gains.proposal import AssessedGains, Proposal, SteeringLimits
from rover_sweep.gains.speed_proposal import AssessedSpeed, SpeedProposal
from rover_sweep.identification.fit import Estimate

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from rover_sweep.identification.pipeline import Identification
    from rover_sweep.report.document import Table as ReportTable
    from sitl.plant.variant import PlantParameters

LARGE = 2.0  # factor of a gain from which the change is tried off the ground first


def show_gains(console: Console, proposal: Proposal, limits: SteeringLimits | None) -> None:
    """Print the verdict, a table of current and proposed gains and limits, and notes."""
    _say(console, _verdict(proposal))
    for reason in proposal.support.reasons:
        _say(console, f"  because {reason}")
    columns = [j for j in (proposal.now, proposal.proposed) if j is not None]
    if columns:
        console.print()
        console.print(_table(proposal, limits))
        _say(console, _footnote(proposal))
    if limits is not None:
        _say(console, _origin(limits))
    if words := _large_changes(proposal):
        _say(console, words)
    for remark in proposal.support.remarks:
        _say(console, f"note: {remark}")
    if proposal.autopilot.assumed and columns:
        _say(console, f"note: {proposal.autopilot.assumed_words} Give them with --now or --connect.")


def _verdict(proposal: Proposal) -> str:
    at, (low, high) = f"for {proposal.speed:.2f} m/s", proposal.speed_range
    words = {
        "gains": f"Gains {at}, valid from {low:.2f} to {high:.2f} m/s",
        "feed-forward only": f"Only the feed-forward gain can be computed {at}",
        "none": f"No gains can be computed {at}",
    }
    return f"{words[proposal.support.level]} ({proposal.found.name} model, {proposal.found.level})."


def _table(proposal: Proposal, limits: SteeringLimits | None):  # type: ignore[no-untyped-def]
    from rich.table import Table

    table = Table(box=None, padding=(0, 2, 0, 0))
    table.add_column("", no_wrap=True)
    unread = set(proposal.now.gains.parameters if proposal.now else ()) <= set(proposal.autopilot.assumed)
    pairs = (("firmware default" if unread else "now", proposal.now), ("proposed", proposal.proposed))
    shown = [(heading, judged) for heading, judged in pairs if judged is not None]
    for heading, _ in shown:
        table.add_column(heading, justify="right", no_wrap=True)
    columns = [
        _column(judged, _limits(proposal, limits, heading) if limits else {}) for heading, judged in shown
    ]
    if proposal.now is not None and not unread:
        for name in set(columns[0]) & set(proposal.autopilot.assumed):
            columns[0][name] += " (firmware default)"
    for label in columns[0]:
        table.add_row(label, *(column[label] for column in columns))
    return table


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
        confirmed += "; it stays as it is, because more was not tested"
    return f"{words} ATC_TURN_MAX_G: {confirmed}."


def _column(judged: AssessedGains, limits: dict[str, str]) -> dict[str, str]:
    step, margins = judged.step, judged.margins
    return {
        **{name: f"{value:.4g}" for name, value in judged.gains.parameters.items()},
        **limits,
        "gain margin": _db(margins.gain_db),
        "phase margin": _deg(margins.phase_deg),
        "worst gain margin": _db(judged.worst_gain[0]),
        "worst phase margin": _deg(judged.worst_phase[0]),
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


def _footnote(proposal: Proposal) -> str:
    worst = proposal.proposed or proposal.now
    assert worst is not None
    return (
        "Worst margins within the 90 % intervals of the parameters and the valid speeds; gain margin at "
        f"{worst.worst_gain[1]}, phase margin at {worst.worst_phase[1]}. "
        "Steps include the firmware's limits on the target."
    )


def _db(value: float) -> str:
    return f"{value:.1f} dB" if math.isfinite(value) else "unlimited"


def _deg(value: float) -> str:
    return f"{value:.0f} deg" if math.isfinite(value) else "unlimited"


def _number(value: float, unit: str) -> str:
    return f"{value:.3g} {unit}" if math.isfinite(value) else "never"


def _say(console: Console, text: str) -> None:
    console.print(text, markup=False, soft_wrap=True)


# Current and proposed settings of the speed loop on the terminal.


def show_speed_gains(console: Console, proposal: SpeedProposal) -> None:
    """Print the verdict, a table of current and proposed settings, and notes."""
    low, _, high = proposal.found.speeds
    words = {
        "gains": f"Speed loop for {low:.2f} to {high:.2f} m/s",
        "cruise only": "Only CRUISE_SPEED and CRUISE_THROTTLE can be computed",
        "none": "No speed gains can be computed from these throttle sweeps",
    }
    _say(console, f"{words[proposal.level]} (identification: {proposal.found.level}).")
    for reason in proposal.reasons:
        _say(console, f"  because {reason}")
    if proposal.now is not None:
        console.print()
        console.print(_speed_table(proposal))
    if proposal.throttle_min is not None:
        _say(
            console,
            f"MOT_THR_MIN {proposal.throttle_min:g} % (now {100 * proposal.loop.least:g}): the motor "
            "controller's dead zone; counts in all modes, MANUAL too",
        )
    for remark in proposal.remarks:
        _say(console, f"note: {remark}")
    if proposal.now is not None and proposal.loop.assumed:
        _say(console, f"note: assumed at the firmware's defaults: {', '.join(proposal.loop.assumed)}.")


def _speed_table(proposal: SpeedProposal) -> Table:
    from rich.table import Table

    table = Table(box=None, padding=(0, 2, 0, 0))
    table.add_column("", no_wrap=True)
    before = "firmware default" if "ATC_SPEED_P" in proposal.loop.assumed else "now"
    pairs = ((before, proposal.now), ("proposed", proposal.proposed))
    columns = [(heading, _speed_column(judged)) for heading, judged in pairs if judged is not None]
    for heading, _ in columns:
        table.add_column(heading, justify="right", no_wrap=True)
    for label in columns[0][1]:
        table.add_row(label, *(column[label] for _, column in columns))
    return table


def _speed_column(judged: AssessedSpeed) -> dict[str, str]:
    step, margins = judged.step, judged.margins
    return {
        **{name: f"{value:.4g}" for name, value in judged.settings.parameters.items()},
        "gain margin": _finite(margins.gain_db, ".1f", "dB"),
        "phase margin": _finite(margins.phase_deg, ".0f", "deg"),
        "worst gain margin": _finite(judged.worst_gain, ".1f", "dB"),
        "worst phase margin": _finite(judged.worst_phase, ".0f", "deg"),
        "crossover frequency": _finite(margins.crossover, ".3g", "rad/s"),
        f"step of {step.size:.1f} m/s from {step.start:.1f} m/s: rise": _finite(step.rise, ".2f", "s"),
        "  overshoot": f"{step.overshoot:.1f} %",
        "  error to the firmware's target": f"{step.error:.3f} m/s rms",
        "  throttle used": f"{100 * step.throttle:.0f} %",
    }


def _finite(value: float, spec: str, unit: str) -> str:
    return f"{value:{spec}} {unit}" if math.isfinite(value) else "unlimited"


# A simulated rover's true parameters compared with the identified ones.


_PHYSICAL = ("roll-yaw", "bicycle")  # models with physical parameters, whose true values are known


def truth_table(result: Identification, rover: PlantParameters) -> ReportTable | None:
    """True and identified numbers, else the recommended physical model's parameters; None without any."""
    from rover_sweep.data.results import number
    from rover_sweep.identification.acceptance import TITLES, usable
    from rover_sweep.report.document import Cell, Table
    from rover_sweep.report.wording import change, symbol, unit

    models = usable(result)
    name = next((n for n in (result.recommended, *_PHYSICAL) if n in models and n in _PHYSICAL), None)
    if name is None:
        return None
    true = truth(rover)
    found: tuple[Estimate | Quantity, ...] = tuple(result.numbers)
    found = found or tuple(e for e in models[name].fit.estimates if e.free)
    rows = tuple(
        (
            Cell(symbol(e.name)),
            Cell(unit(e.unit)),
            Cell(number(true[e.name])),
            Cell(number(e.value)),
            Cell(change(100 * (e.value / true[e.name] - 1)), "strong"),
        )
        for e in found
        if true.get(e.name)
    )
    tied = (
        "Cf = Cr: mean of both axles, at zero slip."
        if any(e.name == "C" for e in found)
        else "Cf, Cr: at zero slip."
    )
    note = (
        f"{tied} τ: lag and delay of the servo. The 90 % intervals below include a lag of the steering and "
        "the saturation of the tyres, and no other physics that the model leaves out."
    )
    if rover.effects:
        note += f" The rover also has effects that no model includes: {', '.join(rover.effects)}."
    column = "identified" if result.numbers else f"{TITLES[name]} model"
    headings = ("", "", "true", column, "difference %")
    return Table("True parameters of the simulated rover", headings, rows, note, 2)


def truth(rover: PlantParameters) -> dict[str, float]:
    """The plant's true parameters by the models' names, in SI units."""
    front, rear = rover.front_cornering_stiffness, rover.rear_cornering_stiffness
    return {
        "C": (front + rear) / 2,
        "Cf": front,
        "Cr": rear,
        "Izz": rover.yaw_inertia,
        "Ixx": rover.roll_inertia,
        "h": rover.cg_height_above_roll_centre,
        "k_phi": rover.roll_stiffness,
        "b_phi": rover.roll_damping,
        "tau": rover.servo_lag + rover.servo_delay,
    }
