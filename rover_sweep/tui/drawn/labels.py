"""Names for numbers and codes of vehicle and applet; clear without colour."""

from __future__ import annotations

import math

from firmware_params.applet_parameters import SWITCH_HIGH, SWITCH_LOW
from rover_sweep.manoeuvre.multisine import Multisine
from rover_sweep.manoeuvre.sweep import Doublet, Manoeuvre, Sweep
from rover_sweep.vehicle import modes as vehicle_modes

MODES = {**vehicle_modes.MODES, 16: "STARTING"}  # short enough for the head of a screen
# GPS_FIX_TYPE (MAVLink common)
FIXES = {0: "no GPS", 1: "no fix", 2: "2D fix", 3: "3D fix", 4: "DGPS", 5: "RTK float", 6: "RTK fixed"}
# state of a check: (sign, word)
CHECKS = {
    "good": ("✓", "good"),
    "doubtful": ("?", "doubtful"),
    "bad": ("✗", "BAD"),
    "unknown": ("·", "unknown"),
}
APPLET = {
    0: "idle",
    1: "records standstill",
    2: "waits for speed",
    3: "straight, before",
    4: "fades in",
    5: "dwells at w_min",
    6: "steers",
    7: "fades out",
    8: "straight, after",
    9: "records standstill",
    10: "stopped",
}
ADVICE = {"keep": ("✓", "KEEP"), "repeat": ("↻", "REPEAT"), "discard": ("✗", "DISCARD")}
OUTCOMES = {
    "asked": ("·", "requested"),
    "running": ("▶", "running"),
    "done": ("✓", "complete"),
    "stopped": ("✗", "stopped"),
    "failed": ("✗", "failed"),
}
RESPONSES = {"r": "yaw rate", "ay": "lateral acc.", "vydot": "V_y rate", "p": "roll rate"}


def mode_label(custom_mode: int) -> str:
    """Name of a Rover mode."""
    return MODES.get(custom_mode, "mode ?" if custom_mode < 0 else f"mode {custom_mode}")


def switch_label(pwm: float) -> str:
    """Position of a switch as the firmware reads it: low, in the middle or high."""
    if not math.isfinite(pwm) or pwm <= 0:
        return "?"
    return "LOW" if pwm < SWITCH_LOW else "HIGH" if pwm > SWITCH_HIGH else "MIDDLE"


def manoeuvre(m: Manoeuvre) -> str:
    """A manoeuvre in one line."""
    about = f" about {m.middle:+g}" if isinstance(m, Sweep) and m.middle else ""
    kind = "throttle sweep" if m.kind == "throttle" else m.kind.replace("_", " ")
    if isinstance(m, Sweep | Multisine):
        return f"{kind} ±{m.amplitude:g} us{about}, {m.w_min:g} to {m.w_max:g} rad/s"
    assert isinstance(m, Doublet)
    return f"{kind} ±{m.amplitude:g} us, {m.count} of {m.pulse:g} s"


def size(count: int) -> str:
    """A number of bytes in kB or MB."""
    return f"{count / 1e6:.1f} MB" if count >= 1e5 else f"{count / 1e3:.0f} kB"


def seconds(value: float) -> str:
    """A duration in s, or in min and s."""
    return f"{value:.0f} s" if value < 100 else f"{int(value) // 60} min {int(value) % 60:02d} s"
