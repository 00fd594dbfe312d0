"""Divides runs into those to fit and those to verify on, and refuses runs in both."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations, product

import numpy as np

from rover_sweep.data.recording import Note, Recording
from rover_sweep.errors import DataRefused, UsageError
from rover_sweep.quality.faults import is_unexcited

LEFT_OUT = (
    "is not fitted: a sweep about a steering offset shows the rover near a steady turn, and the other "
    "runs show it near straight driving; identify it alone, or use it in diagnose"
)


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
    """True for the same run of the same file (by SHA-256), under any name; a pair equals each of its logs.

    Runs of one file differ in their time, or in their yaw rate if the file holds trials with restarted
    clocks.
    """
    first, second = ({digest for _, digest in run.sources} for run in (one, two))
    if not first & second:
        return False
    if first == second:
        return one.span == two.span and np.array_equal(one["r"].x, two["r"].x)
    shared = min(one.span[1], two.span[1]) - max(one.span[0], two.span[0])
    nested = first < second or second < first
    return nested and shared > 0.5 * min(run.span[1] - run.span[0] for run in (one, two))
