"""Current and proposed settings of the speed loop on the terminal."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from rover_sweep.gains.speed_proposal import AssessedSpeed, SpeedProposal

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table


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
        console.print(_table(proposal))
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


def _table(proposal: SpeedProposal) -> Table:
    from rich.table import Table

    table = Table(box=None, padding=(0, 2, 0, 0))
    table.add_column("", no_wrap=True)
    before = "firmware default" if "ATC_SPEED_P" in proposal.loop.assumed else "now"
    pairs = ((before, proposal.now), ("proposed", proposal.proposed))
    columns = [(heading, _column(judged)) for heading, judged in pairs if judged is not None]
    for heading, _ in columns:
        table.add_column(heading, justify="right", no_wrap=True)
    for label in columns[0][1]:
        table.add_row(label, *(column[label] for _, column in columns))
    return table


def _column(judged: AssessedSpeed) -> dict[str, str]:
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


def _say(console: Console, text: str) -> None:
    console.print(text, markup=False, soft_wrap=True)
