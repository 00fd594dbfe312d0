"""Names of ArduRover's modes (Rover/mode.h, Mode::Number, 4.5 and 4.6)."""

from __future__ import annotations

MODES = {
    0: "MANUAL",
    1: "ACRO",
    3: "STEERING",
    4: "HOLD",
    5: "LOITER",
    6: "FOLLOW",
    7: "SIMPLE",
    8: "DOCK",
    9: "CIRCLE",
    10: "AUTO",
    11: "RTL",
    12: "SMART_RTL",
    15: "GUIDED",
    16: "INITIALISING",
}


def mode_name(mode: int) -> str:
    """Rover's custom_mode as a word (Rover/mode.h, 4.6.3)."""
    return MODES.get(mode, f"mode {mode}")
