"""Contrast of two colours by WCAG 2.1."""

from __future__ import annotations

LEAST_CONTRAST = 7.0  # WCAG 2.1, 1.4.6 (AAA)


def contrast(one: str, other: str) -> float:
    """WCAG 2.1 contrast ratio of two colours #rrggbb, 1..21."""
    light, dark = sorted((_luminance(one), _luminance(other)), reverse=True)
    return (light + 0.05) / (dark + 0.05)


def _luminance(colour: str) -> float:
    shares = (int(colour[n : n + 2], 16) / 255 for n in (1, 3, 5))
    linear = [s / 12.92 if s <= 0.04045 else ((s + 0.055) / 1.055) ** 2.4 for s in shares]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]
