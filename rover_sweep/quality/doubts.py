"""Why no model of some runs is called good, though it fits: what the data cannot show of themselves."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from rover_sweep.data.recording import ASSUMED, Recording

# How the notes of a recording that is not whole begin (logs.completeness).
CUT = ("The recording ends before", "The recording begins after", "The recording has a hole", "A hole of")


def doubts(runs: Sequence[Recording]) -> tuple[str, ...]:
    """A sentence for each reason."""
    return (*_assumed(runs), *_cut(runs))


def _assumed(runs: Sequence[Recording]) -> Iterator[str]:
    """The low-pass of a sensor was assumed: with 4 Hz for none, C 24 was found for 32, at J_ave 18."""
    found = sorted({c for run in runs for c, low in run.filters.items() if low.source == ASSUMED})
    if found:
        yield (
            f"the low-pass of {', '.join(found)} was not recorded and the factory value is assumed; where it "
            "was set otherwise, the parameters are wrong by tens of percent: give --gyro-filter and "
            "--accel-filter"
        )


def _cut(runs: Sequence[Recording]) -> Iterator[str]:
    """No run is whole: of a sweep that ends at 9 rad/s, Izz was 12 % off, at J_ave 1."""
    if all(any(note.text.startswith(CUT) for note in run.notes) for run in runs):
        names = ", ".join(run.name for run in runs)
        yield f"no run was recorded whole ({names}), so a part of the frequencies is missing: drive one again"
