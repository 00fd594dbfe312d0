"""Runs by their role: to fit, to verify on, and never one in both."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations, product

import numpy as np

from rover_sweep.data.recording import Note, Recording
from rover_sweep.errors import UsageError

LEFT_OUT = (
    "is no part of the fit: a sweep about a steering offset is linear about a turn, and the other runs about "
    "straight driving; identify it alone, or give it to diagnose"
)


def divided(runs: Sequence[Recording]) -> tuple[tuple[Recording, ...], tuple[Recording, ...]]:
    """(runs to identify from, doublets to verify on); doublets alone are identified from.

    A linear model holds about one way of driving: sweeps about a steering offset are left out where there
    are straight runs, and a note on the first of these says so.
    """
    others, doublets = doublets_apart(runs)
    biased = [run.name for run in others if run.kind == "bias_sweep"]
    straight = tuple(run for run in others if run.kind != "bias_sweep")
    if not biased or not straight:
        return others, doublets
    note = Note("warning", f"{', '.join(biased)} {LEFT_OUT}")
    return (replace(straight[0], notes=(*straight[0].notes, note)), *straight[1:]), doublets


def doublets_apart(runs: Sequence[Recording]) -> tuple[tuple[Recording, ...], tuple[Recording, ...]]:
    """(all other runs, doublets); doublets alone are the runs."""
    doublets = tuple(r for r in runs if r.kind == "doublet")
    others = tuple(r for r in runs if r.kind != "doublet")
    return (others, doublets) if others else (doublets, ())


def refuse_overlap(sweeps: Sequence[Recording], checks: Sequence[Recording]) -> None:
    """UsageError where a run would be its own judge, or counted twice; a copy of a file is that file."""
    for group in (sweeps, checks):
        for one, two in combinations(group, 2):
            if same_recording(one, two):
                told = "is given twice" if one.name == two.name else f"is the same recording as {one.name}"
                raise UsageError(f"{two.name} {told}, which would count its noise as known; give it once")
    for sweep, check in product(sweeps, checks):
        if same_recording(sweep, check):
            copied = "" if sweep.name == check.name else f" (it is the same recording as {sweep.name})"
            raise UsageError(
                f"{check.name} is both identified from and verified on{copied}; verify on another run"
            )


def same_recording(one: Recording, two: Recording) -> bool:
    """Are both the same run of the same file, whatever its name; a pair counts as each of its logs.

    Told by the files' SHA-256. Runs of one file are told apart by their time, and by their yaw rate where
    a file joins trials whose clocks begin anew.
    """
    first, second = ({digest for _, digest in run.sources} for run in (one, two))
    if not first & second:
        return False
    if first == second:
        return one.span == two.span and np.array_equal(one["r"].x, two["r"].x)
    shared = min(one.span[1], two.span[1]) - max(one.span[0], two.span[0])
    nested = first < second or second < first
    return nested and shared > 0.5 * min(run.span[1] - run.span[0] for run in (one, two))
