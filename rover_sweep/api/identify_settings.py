"""Checks the settings of an identification against the runs, before the fit."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rover_sweep.data.recording import Recording
from rover_sweep.data.vehicle_geometry import MODEL_NAMES
from rover_sweep.errors import UsageError
from rover_sweep.identification.grouping import Settings
from rover_sweep.identification.models.lumped import COLUMNS, ROWS

STEERED = ("delta", "pwm", "r", "p", "phi", "psi", "ay", "vy")


def parameter_names(names: Sequence[str]) -> tuple[str, ...]:
    """Model parameters, given by name or by key of the vehicle file; UsageError for unknown names."""
    derivatives = [f"{row}_{column}" for row in ROWS for column in COLUMNS]
    known = [*MODEL_NAMES.values(), "C", "Cf", "Cr", "k_phi", "b_phi", "tau", *derivatives]
    found = tuple(MODEL_NAMES.get(name, name) for name in names)
    for name in found:
        if name not in known:
            raise UsageError(f"there is no parameter {name!r}; choose from {', '.join(known)}")
    return found


def check_settings(settings: Settings, runs: Sequence[Recording]) -> None:
    """UsageError for settings that are impossible with these runs."""
    longest = max(run.span[1] - run.span[0] for run in runs)
    fastest = math.pi * min(run[c].rate for run in runs for c in ("delta", "r") if c in run)
    limits = (x for band in settings.bands.values() for x in band)
    numbers = [*(settings.band or ()), *(settings.windows or ()), *limits]
    if not all(math.isfinite(x) for x in numbers):
        raise UsageError("frequencies and window lengths must be finite numbers")
    if "r" not in settings.fitted:
        raise UsageError("the fit needs the yaw rate: --fit r, r,ay or r,ay,p")
    if settings.bootstrap != 0 and settings.bootstrap < 20:
        raise UsageError(
            f"{settings.bootstrap} bootstrap replicates are too few; use 20 or more, or 0 for none"
        )
    if settings.windows and not 0.5 <= min(settings.windows) <= max(settings.windows) <= longest:
        raise UsageError(f"window lengths must be between 0.5 s and the longest run, {longest:.3g} s")
    if settings.band and settings.band[1] > fastest:
        raise UsageError(
            f"--wmax {settings.band[1]:g} is above the highest frequency of these logs, {fastest:.3g} rad/s "
            "(half the sampling rate of steering or yaw rate)"
        )
    if settings.band and settings.band[0] < 2 * math.pi / longest:
        raise UsageError(
            f"--wmin {settings.band[0]:g} rad/s has a period longer than the longest run, {longest:.3g} s"
        )
    _check_inputs(settings.condition_on, runs)
    for name, (low, high) in settings.bands.items():
        if high > fastest or low < 2 * math.pi / longest or high < 1.5 * low:
            within = f"{2 * math.pi / longest:.2g} and {fastest:.3g} rad/s"
            raise UsageError(
                f"--band {name}={low:g}:{high:g} must be between {within} and span a factor of 1.5 or more"
            )


def _check_inputs(names: Sequence[str], runs: Sequence[Recording]) -> None:
    """UsageError for further inputs that were not recorded, or that are the steering or an output."""
    for name in names:
        if name in STEERED:
            raise UsageError(f"{name} is the steering or follows it; condition on an independent input")
        lacking = [run for run in runs if name not in run]
        if lacking:
            there = ", ".join(c for c in lacking[0].channels if c not in STEERED) or "nothing else"
            raise UsageError(f"{lacking[0].name} has no {name!r} to condition on; it holds {there}")
