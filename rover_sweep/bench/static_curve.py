"""From the fitted static curve to the numbers of a vehicle file. Pure."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from rover_sweep.bench.bench_result import Number, interval
from rover_sweep.bench.linkage import curve
from rover_sweep.data.recording import Array

MEANINGS = {
    "trim": ("trim_us", "us", "PWM at which the wheels point straight ahead"),
    "e": ("asymmetry", "-", "gain (1 + e) to the left, (1 - e) to the right"),
    "c3": ("nonlinearity", "1/rad^2", "gain 1 + c3 u^2"),
    "w": ("deadband", "rad", "half width of the band about the trim in which the wheels do not move"),
    "b": ("backlash", "rad", "half of the gap, at the road wheel"),
}
NOT_NEGATIVE = ("w", "b")


def static_numbers(
    names: Sequence[str], x: Array, covariance: Array, factor: float, reach: float
) -> tuple[Number, ...]:
    """rad_per_us over +-`reach` us and at its centre, either side's, and what else was fitted.

    names: of x (n,); covariance (n, n); factor: half an interval in standard deviations.
    """

    def of(function: Callable[[dict[str, float]], float]) -> tuple[float, float]:
        """A function of the fitted numbers, and its standard deviation to first order."""
        deviation = np.sqrt(np.diag(covariance))
        here = function(dict(zip(names, x, strict=True)))
        slopes = np.zeros(len(names))
        for k in range(len(names)):
            stride = max(1e-3 * float(deviation[k]), 1e-12)
            moved = x.copy()
            moved[k] += stride
            slopes[k] = (function(dict(zip(names, moved, strict=True))) - here) / stride
        return here, float(np.sqrt(max(float(slopes @ covariance @ slopes), 0.0)))

    def angle(q: dict[str, float], offset: float) -> float:
        u = np.array([-q["k"] * offset])
        return float(curve(u, q.get("e", 0.0), q.get("c3", 0.0), q.get("w", 0.0))[0])

    def mean(q: dict[str, float]) -> float:
        return (angle(q, -reach) - angle(q, reach)) / (2 * reach)

    slope = interval("rad_per_us", "rad/us", *of(mean), factor, f"mean slope over +-{reach:.0f} us")
    out = [slope]
    if "c3" in names or "w" in names:
        out.append(
            interval("centre", "rad/us", *of(lambda q: q["k"]), factor, "slope u/PWM before the curve")
        )
    if "e" in names:
        out.append(
            interval(
                "left",
                "rad/us",
                *of(lambda q: angle(q, -reach) / reach),
                factor,
                f"mean slope to {reach:.0f} us on the left",
            )
        )
        out.append(
            interval(
                "right",
                "rad/us",
                *of(lambda q: -angle(q, reach) / reach),
                factor,
                f"mean slope to {reach:.0f} us on the right",
            )
        )
    for name, (title, unit, meaning) in MEANINGS.items():
        if name in names:
            k = list(names).index(name)
            sd = float(np.sqrt(covariance[k, k]))
            least = 0.0 if name in NOT_NEGATIVE else -np.inf
            out.append(interval(title, unit, float(x[k]), sd, factor, meaning, f"steering.{title}", least))
    return tuple(out)
