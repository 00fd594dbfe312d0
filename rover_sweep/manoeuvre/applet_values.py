"""A manoeuvre as the parameters of the applet."""

from __future__ import annotations

import math
from dataclasses import asdict

from firmware_params.applet_parameters import for_manoeuvre
from rover_sweep.errors import UsageError
from rover_sweep.manoeuvre.multisine import Multisine
from rover_sweep.manoeuvre.sweep import Manoeuvre, Sweep

LEAST_SAMPLES = 10  # per period of the highest frequency


def parameters_of(manoeuvre: Manoeuvre, **others: float) -> dict[str, float]:
    """SWP_ parameters [us, rad/s, s] that make the applet drive this manoeuvre.

    others: further parameters, such as limits, by the applet's names without prefix (v_max, roll_max, ...).
    UsageError for values that the applet would refuse.
    """
    numbers = asdict(manoeuvre)
    if twice := sorted(numbers.keys() & others.keys()):
        raise UsageError(f"{', '.join(twice)}: set by the manoeuvre; remove it from the limits")
    try:
        return for_manoeuvre(numbers.pop("kind"), **numbers, **others)
    except ValueError as error:
        raise UsageError(str(error)) from error


def refuse_undersampled(manoeuvre: Manoeuvre, loop_rate: float) -> None:
    """UsageError when w_max is too high for a SCHED_LOOP_RATE [Hz]: below 10 samples per period."""
    top = 2 * math.pi * loop_rate / LEAST_SAMPLES
    if isinstance(manoeuvre, Sweep | Multisine) and manoeuvre.w_max > top:
        samples = 2 * math.pi * loop_rate / manoeuvre.w_max
        raise UsageError(
            f"w_max {manoeuvre.w_max:g} rad/s has {samples:.1f} samples per period at the loop rate of "
            f"{loop_rate:g} Hz, but {LEAST_SAMPLES} are needed: use {math.floor(top):g} rad/s or less"
        )
