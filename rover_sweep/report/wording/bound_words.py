"""What could still hide in the runs of a diagnosis, in words."""

from __future__ import annotations

from collections.abc import Sequence

from rover_sweep.diagnosis.result import Unseen, UpperBound, largest_hidden
from rover_sweep.report.wording.effect_names import title
from rover_sweep.report.wording.number_format import number, unit

EVEN = 0.03  # relative difference of both ends of a range up to which they count as equal


def range_words(bound: UpperBound) -> str:
    """The range that is not excluded, without its unit."""
    low, high = bound.low, bound.high
    if low is not None and high is not None and low < 0.0:
        if abs(low + high) <= EVEN * (high - low):
            return f"\N{PLUS-MINUS SIGN}{_short(max(high, -low))}"
        return f"{_short(low)} to {_short(high)}"
    if high is None:
        return "any" if low is None else f"at least {_short(low)}"
    return f"up to {_short(high)}" if not low else f"{_short(low)} to {_short(high)}"


def _short(value: float) -> str:
    """Two digits, three from 1 to 2, where a ratio has its values."""
    return number(value, 3 if 1.0 <= abs(value) < 2.0 else 2)


def hiding_words(unseen: Sequence[Unseen]) -> str:
    """The effects that matter most among those that could still hide, in one sentence; "" for none."""
    return ", ".join(_effect(u) for u in largest_hidden(unseen))


def _effect(u: Unseen) -> str:
    parts = []
    for name, bound in u.up_to.items():
        named = f"{name} " if len(u.up_to) > 1 else ""
        of = unit(bound.unit).replace("-", "") if bound.unit == "-" else unit(bound.unit)
        parts.append(f"{named}{range_words(bound)} {of}".rstrip())
    return f"{title(u.effect)} ({', '.join(parts)})"
