"""Reasons not to call a model good although it fits: errors that the data themselves cannot show."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from rover_sweep.data.recording import ASSUMED, Recording

# First words of the notes on an incomplete recording (logs.runs.completeness).
CUT = ("The recording ends before", "The recording begins after", "The recording has a hole", "A hole of")


def doubts(runs: Sequence[Recording]) -> tuple[str, ...]:
    """A sentence for each reason not to trust a good fit to these runs."""
    return (*_assumed(runs), *_cut(runs))


def _assumed(runs: Sequence[Recording]) -> Iterator[str]:
    """An assumed low-pass: 4 Hz assumed for none gave C = 24 instead of 32 N/rad, at J_ave 18."""
    found = sorted({c for run in runs for c, low in run.filters.items() if low.source == ASSUMED})
    if found:
        yield (
            f"the low-pass of {', '.join(found)} was not recorded and the default value is assumed; if it "
            "was set otherwise, the parameters are wrong by tens of percent: give --gyro-filter and "
            "--accel-filter"
        )


def _cut(runs: Sequence[Recording]) -> Iterator[str]:
    """No complete run: a sweep that ended at 9 rad/s gave Izz with an error of 12 %, at J_ave 1."""
    if all(any(note.text.startswith(CUT) for note in run.notes) for run in runs):
        names = ", ".join(run.name for run in runs)
        yield f"no run was recorded completely ({names}), so some frequencies are missing: drive one again"
