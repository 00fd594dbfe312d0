"""A Sweep or Doublet as the parameters of the applet."""

from __future__ import annotations

from dataclasses import asdict

from firmware_params.parameters import for_manoeuvre
from rover_sweep.errors import UsageError
from rover_sweep.identify.sweep import Manoeuvre


def parameters_of(manoeuvre: Manoeuvre, **others: float) -> dict[str, float]:
    """SWP_ parameters [us, rad/s, s] that make the applet drive this manoeuvre.

    others: limits and the like in the applet's names without prefix (v_max, roll_max, still, ...).
    UsageError for what the applet would refuse.
    """
    numbers = asdict(manoeuvre)
    try:
        return for_manoeuvre(numbers.pop("kind"), **numbers, **others)
    except ValueError as error:
        raise UsageError(str(error)) from error
