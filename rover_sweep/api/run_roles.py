"""Divides runs into those to fit and those to verify on, and refuses runs in both."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations, product
from pathlib import Path

import numpy as np

from rover_sweep.data.recording import Note, Recording
from rover_sweep.errors import DataRefused, UsageError
from rover_sweep.quality.faults import is_unexcited

LEFT_OUT = (
    "is not fitted: a sweep about a steering offset shows the rover near a steady turn, and the other "
    "runs show it near straight driving; identify it alone, or use it in diagnose"
)


_BLOCK = 64  # samples of a run that no other run has
_ROUNDED = 1e-3  # a copy's rounding over the standard deviation of the yaw rate
_GRID, _SAME_DRIVE = 50.0, 0.95  # Hz; correlation of two logs of one drive, without a shift in time


def divided(runs: Sequence[Recording]) -> tuple[tuple[Recording, ...], tuple[Recording, ...]]:
    """(runs to fit, doublets to verify on); DataRefused where no run can be fitted.

    A linear model is valid about one operating point, so sweeps about a steering offset are left out when
    there are straight runs; the first of these gets a note.
    """
    refuse_without_sweep(runs)
    others, doublets = doublets_apart(runs)
    biased = [run.name for run in others if run.kind == "bias_sweep"]
    straight = tuple(run for run in others if run.kind != "bias_sweep")
    if not biased or not straight:
        return others, doublets
    note = Note("warning", f"{', '.join(biased)} {LEFT_OUT}")
    return (replace(straight[0], notes=(*straight[0].notes, note)), *straight[1:]), doublets


def fitted_and_verified(
    runs: Sequence[Recording], verify: Sequence[Recording] = ()
) -> tuple[tuple[Recording, ...], tuple[Recording, ...]]:
    """(runs to fit, runs to verify on); by default verified on the doublets. UsageError for a run in both."""
    for run in verify:
        if not isinstance(run, Recording):
            raise UsageError(f'verify: {run!r} is no run; give runs that were read, such as [runs["run4"]]')
    fitted, doublets = divided(runs)
    checks = tuple(verify) or doublets
    refuse_overlap(fitted, checks)
    return fitted, checks


def doublets_apart(runs: Sequence[Recording]) -> tuple[tuple[Recording, ...], tuple[Recording, ...]]:
    """(other runs, doublets)."""
    doublets = tuple(r for r in runs if r.kind == "doublet")
    return tuple(r for r in runs if r.kind != "doublet"), doublets


def refuse_without_sweep(runs: Sequence[Recording]) -> None:
    """DataRefused where no run can be fitted, because all are doublets or have no excitation."""
    if why := why_not_fitted(runs):
        raise DataRefused(why)


def why_not_fitted(runs: Sequence[Recording]) -> str:
    """A sentence on why no run can be fitted, "" if one can."""
    others, doublets = doublets_apart(runs)
    if not runs or not all(map(is_unexcited, others)):
        return ""
    names = ", ".join(run.name for run in doublets or others)
    if doublets:
        are = "is a doublet" if len(doublets) == 1 else "are doublets"
        return (
            f"{names} {are}; a sweep is needed: a doublet verifies a model, but it excites too few "
            "frequencies to fit one; give a sweep too"
        )
    return (
        f"no steering excitation in {names}: the steering is constant; drive a sweep, or give the column of "
        "the steering command"
    )


def refuse_overlap(sweeps: Sequence[Recording], checks: Sequence[Recording]) -> None:
    """UsageError for a run that is given twice, or both fitted and verified on; copies count as one file."""
    for group in (sweeps, checks):
        for one, two in combinations(group, 2):
            if same_recording(one, two):
                problem = "is given twice" if one.name == two.name else f"is the same recording as {one.name}"
                raise UsageError(f"{two.name} {problem}, so its noise would count as signal; give it once")
    for sweep, check in product(sweeps, checks):
        if same_recording(sweep, check):
            copied = "" if sweep.name == check.name else f" (it is the same recording as {sweep.name})"
            raise UsageError(
                f"{check.name} is used both to identify and to verify{copied}; verify on another run"
            )


def same_recording(one: Recording, two: Recording) -> bool:
    """True for the same drive, under any name: of one file (by SHA-256), of a copy, or of both its logs.

    Runs of one file differ in their time, or in their yaw rate if the file holds trials with restarted
    clocks. A copy, whole or in part, has the samples of the other. The two logs of one drive have the same
    clock and yaw rate.
    """
    first, second = ({digest for _, digest in run.sources} for run in (one, two))
    if not first & second:
        return _copied(one, two) or _two_logs(one, two)
    if first == second:
        return one.span == two.span and np.array_equal(one["r"].x, two["r"].x)
    shared = min(one.span[1], two.span[1]) - max(one.span[0], two.span[0])
    nested = first < second or second < first
    return nested and shared > 0.5 * min(run.span[1] - run.span[0] for run in (one, two))


def _copied(one: Recording, two: Recording) -> bool:
    """True where a block of the shorter run's yaw rates is in the other: noise never repeats.

    The block has the largest changes, so two runs at rest do not count as copies. Rounded copies count.
    """
    short, long = sorted((one["r"].x, two["r"].x), key=np.size)
    if short.size < _BLOCK or not short.std():
        return False
    turning = np.convolve(np.abs(np.diff(short, append=short[-1])), np.ones(_BLOCK), "valid")
    start = int(np.argmax(turning))
    block, alike = short[start : start + _BLOCK], _ROUNDED * short.std()
    begins = np.flatnonzero(np.abs(long[: long.size - _BLOCK + 1] - block[0]) <= alike)
    windows = np.lib.stride_tricks.sliding_window_view(long, _BLOCK)[begins]
    return bool(np.any(np.all(np.abs(windows - block) <= alike, axis=1)))


def _two_logs(one: Recording, two: Recording) -> bool:
    """True for an onboard log and a telemetry log of one drive: both have the autopilot's clock."""
    kinds = [{Path(name).suffix.lower() for name, _ in run.sources} for run in (one, two)]
    if ".tlog" not in kinds[0] ^ kinds[1] or ".bin" not in kinds[0] | kinds[1]:
        return False
    begin, end = (choose(run.span[i] for run in (one, two)) for i, choose in enumerate((max, min)))
    if end - begin < 0.5 * min(run.span[1] - run.span[0] for run in (one, two)):
        return False
    grid = np.arange(begin, end, 1 / _GRID)
    return bool(np.corrcoef(one["r"].on(grid), two["r"].on(grid))[0, 1] > _SAME_DRIVE)
