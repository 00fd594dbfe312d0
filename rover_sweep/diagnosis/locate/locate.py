"""Where a model and the recordings differ, in multiples of the noise floor.

A place is reported where the residual is both large and significantly above the noise. A condition is
reported where this also holds against a reference: other runs, the other turn, the orders next to a harmonic.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.locate.by_band import by_frequency, by_run, worst_band
from rover_sweep.diagnosis.locate.by_harmonic import by_order
from rover_sweep.diagnosis.locate.by_time import by_time
from rover_sweep.diagnosis.locate.by_turn import by_heading, by_turn, steady
from rover_sweep.diagnosis.locate.residual_maps import channels_of
from rover_sweep.diagnosis.problem.residuals import Problem
from rover_sweep.diagnosis.result import Mismatch

MOST = 8
Finder = Callable[[Problem, Array, str], Mismatch | None]


def mismatches(problem: Problem, rows: Array) -> tuple[Mismatch, ...]:
    """At most `MOST` places, the largest first: each channel's worst band, the clearest of each condition.

    problem: without tolerances; rows (size,): whitened residual, measured minus model.
    """
    channels = channels_of(problem)
    places = [p for c in channels if (p := worst_band(problem, rows, c)) is not None]
    found = [by_frequency(p) for p in places]
    compared = [m for p in places for m in by_run(problem, rows, p.channel)]
    for over in ("amplitude", "speed"):
        found += _clearest(m for m in compared if m.profile and m.profile.over == over)
    finders: Sequence[Finder] = (steady, by_turn, by_heading, by_time)
    for finder in finders:
        found += _clearest(m for c in channels if (m := finder(problem, rows, c)) is not None)
    found += _clearest(m for c in channels for m in by_order(problem, rows, c))
    return tuple(sorted(found, key=lambda m: -m.residual_over_noise)[:MOST])


def _clearest(places: Iterator[Mismatch]) -> list[Mismatch]:
    """The largest of the places of one condition, since other channels usually show the same."""
    best = max(places, key=lambda m: m.residual_over_noise, default=None)
    return [best] if best else []
