"""A nominal parameter at the end of what is ordinary, which the recordings want farther still.

Where a candidate has it, that is found. Where none has, what else was named may only stand in for it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

from rover_sweep.diagnosis.problem.least_squares import Fitted, fit
from rover_sweep.diagnosis.problem.residuals import Problem, over_noise
from rover_sweep.diagnosis.result import Unknown
from rover_sweep.diagnosis.simulation.nominal import Coordinate

WIDENED = 5.0  # times as far from its start as is ordinary
WORDS = {
    "lag": "the servo's lag",
    "delay": "the steering's delay",
    "trim": "the steering's trim",
    "bias_ay": "the accelerometer's bias",
    "ln_ratio": "the ratio of front to rear cornering stiffness",
    "vy_lag": "the lag of the lateral velocity",
}


@dataclass(frozen=True, eq=False)
class ExceededBound:
    """A coordinate that was let go farther. gain: drop of the cost; channel: where most of it is; ratio: the
    rms of the rows there that it explains over their noise."""

    coordinate: str
    gain: float
    channel: str
    ratio: float


def exceeded_bound(problem: Problem, fitted: Fitted) -> ExceededBound | None:
    """The coordinate whose limit costs most; None where none is at its limit."""
    found = [_released(problem, fitted, c) for c in _at_their_bounds(fitted)]
    return max(found, key=lambda b: b.gain, default=None)


def cost_of(problem: Problem, fitted: Fitted) -> float:
    """Sum of squares that a model fitted in another metric leaves in this one."""
    rows = problem.measured - problem.model(fitted.structure, fitted.x)
    return float(rows @ rows)


def unknown_at_bound(exceeded: ExceededBound, withdrawn: tuple[str, ...]) -> Unknown:
    """The answer: what is wanted, and that it explains more than what would have been named."""
    what = WORDS[exceeded.coordinate]
    return Unknown(
        exceeded.channel,
        what,
        exceeded.ratio,
        f"the recordings want {what} beyond what is ordinary, which explains more than "
        f"{' and '.join(withdrawn)} would; no candidate explains it",
    )


def _at_their_bounds(fitted: Fitted) -> Iterator[Coordinate]:
    for c in fitted.free:
        room = 1e-6 * c.scale
        if c.name in WORDS and not c.low + room < fitted.x[c.name] < c.high - room:
            yield c


def _released(problem: Problem, fitted: Fitted, c: Coordinate) -> ExceededBound:
    low = c.low if c.low == 0.0 else c.start - WIDENED * (c.start - c.low)
    wide = replace(c, low=low, high=c.start + WIDENED * (c.high - c.start))
    free = tuple(wide if one.name == c.name else one for one in fitted.free)
    freed = fit(problem, fitted.structure, free, fitted.x, known=fitted)
    less = {}
    for channel in {r.channel for r in problem.rows}:
        before, after = (problem.part(f.rows, channel=channel) for f in (fitted, freed))
        less[channel] = float(before @ before - after @ after)
    channel = max(less, key=lambda name: less[name])
    rows = problem.part(fitted.rows - freed.rows, channel=channel)
    return ExceededBound(c.name, fitted.cost - freed.cost, channel, over_noise(less[channel], rows))
