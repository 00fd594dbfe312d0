"""The manoeuvre configured in the applet's parameters."""

from __future__ import annotations

from collections.abc import Mapping

from firmware_params.applet_parameters import PARAMETERS, PREFIX, TYPES
from rover_sweep.manoeuvre.multisine import Multisine
from rover_sweep.manoeuvre.sweep import BiasSweep, Doublet, Manoeuvre, Sweep, ThrottleSweep

_DEFAULTS = {p.name: p.default for p in PARAMETERS}


def configured_manoeuvre(values: Mapping[str, float]) -> Manoeuvre | None:
    """The manoeuvre of these SWP_ parameters [us, rad/s, s]; missing ones have their defaults.

    None without any SWP_ parameter, or for values that the applet would refuse.
    """
    if not any(name.startswith(PREFIX) for name in values):
        return None
    known = {**_DEFAULTS, **values}
    try:
        return _made(known)
    except ValueError:
        return None


def _made(known: Mapping[str, float]) -> Manoeuvre | None:
    amplitude, count = known["SWP_AMP"], round(known["SWP_COUNT"])
    straight, fade, dwell = (known[f"SWP_{name}"] for name in ("STRAIGHT", "FADE", "DWELL"))
    kind = next((kind for kind, number in TYPES.items() if number == round(known["SWP_TYPE"])), "")
    if kind == "doublet":
        return Doublet(amplitude, known["SWP_PULSE"], known["SWP_PAUSE"], count, straight)
    low, high, length = known["SWP_WMIN"], known["SWP_WMAX"], known["SWP_TREC"]
    if kind == "multisine":
        return Multisine(amplitude, low, high, length, count, fade, dwell, straight)
    if kind == "bias_sweep":
        return BiasSweep(amplitude, low, high, length, fade, dwell, straight, bias=known["SWP_BIAS"])
    if kind == "throttle":
        return ThrottleSweep(amplitude, low, high, length, fade, dwell, straight)
    return Sweep(amplitude, low, high, length, fade, dwell, straight) if kind == "sweep" else None
