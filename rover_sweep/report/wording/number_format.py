"""Text forms of numbers, parameter names and units."""

from __future__ import annotations

import math

OUTPUT_NAMES = {
    "r": "yaw rate r",
    "ay": "lateral acceleration a_y",
    "vydot": "lateral velocity rate V̇_y",
    "p": "roll rate p",
}
SHORT_NAMES = {"r": "r", "ay": "a_y", "vydot": "V̇_y", "p": "p"}
SYMBOLS = {
    "C": "Cf = Cr",
    "tau": "τ",
    "k_phi": "k_φ",
    "b_phi": "b_φ",
    "Izz": "I_zz",
    "Ixx": "I_xx",
    "Ixz": "I_xz",
    "ms": "m_s",
    "V": "V_x",
}


def number(value: float | None, digits: int = 4) -> str:
    """The value with `digits` significant digits; an exponent only below 1e-4 and from 1e6; – for None."""
    if value is None or not math.isfinite(value):
        return "–"
    if value == 0:
        return "0"
    size = math.floor(math.log10(abs(value)))
    if not -4 <= size <= 5:
        return f"{value:.{digits - 1}e}"
    return f"{value:.{max(digits - 1 - size, 0)}f}"


def percent(value: float | None) -> str:
    """A percentage with three significant digits, without its sign %."""
    if value is None or not math.isfinite(value):
        return "–"
    return "> 1000" if value >= 1000 else number(value, 3)


def change(value: float | None) -> str:
    """A change in percent with its sign, to a tenth."""
    if value is None or not math.isfinite(value):
        return "–"
    return "> +1000" if value >= 1000 else f"{round(value, 1) + 0.0:+.1f}"  # + 0.0: no -0.0


def band(limits: tuple[float, float] | None) -> str:
    """A frequency band in rad/s, – for none."""
    return f"{limits[0]:.2g}–{limits[1]:.3g}" if limits else "–"


def symbol(parameter: str) -> str:
    """A parameter as the paper writes it."""
    if parameter in SYMBOLS:
        return SYMBOLS[parameter]
    return parameter.replace("_phi", "_φ").replace("_delta", "_δ")


def unit(text: str) -> str:
    """A unit with its exponents raised."""
    return text.replace("^2", "²")
