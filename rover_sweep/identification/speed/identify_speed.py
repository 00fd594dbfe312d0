"""Identifies the response of the speed to the throttle, and judges it. A poor result is an answer with
reasons.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rover_sweep.data.throttle_run import ThrottleRun
from rover_sweep.identification.speed.coasting import Coasting, coasting
from rover_sweep.identification.speed.speed_fit import SpeedFit, fit_speed, grid_of
from rover_sweep.identification.speed.throttle_coherence import ThrottleCoherence, throttle_coherence

LEAST_SPAN = 0.05  # share of full throttle that must be swept, peak to peak
LEAST_SPEED_SPAN = 0.15  # m/s, peak to peak: several times the noise of an EKF on GPS
GOOD_FIT, FAIR_FIT = 0.9, 0.7  # share of the speed's variation
WIDE = 0.35  # relative half-width of an interval above which a parameter is not identified
LEAST_BAND = 4.0  # highest over lowest usable frequency


@dataclass(frozen=True, eq=False)
class SpeedResult:
    """The response of the speed to the throttle.

    level: "good", "acceptable", "poor" or "none"; reasons: why not better, with what to do. fit, coherence,
    coasting: None if there is none. speeds: (lowest, mean, highest) of the sweeps [m/s]; throttles: lowest
    and highest throttle of the sweeps (share of full).
    """

    runs: tuple[ThrottleRun, ...]
    level: str
    reasons: tuple[str, ...]
    speeds: tuple[float, float, float]
    throttles: tuple[float, float]
    fit: SpeedFit | None = None
    coherence: ThrottleCoherence | None = None
    coasting: Coasting | None = None


def identify_speed(runs: Sequence[ThrottleRun]) -> SpeedResult:
    """The result of all throttle sweeps of one rover together; ValueError without a run."""
    if not runs:
        raise ValueError("there is no throttle sweep")
    v = np.concatenate([run.speed.on(grid_of(run)) for run in runs])
    u = np.concatenate([run.drive(grid_of(run)) for run in runs])
    speeds = (float(v.min()), float(v.mean()), float(v.max()))
    throttles = (float(u.min()), float(u.max()))
    if why := _unexcited(throttles, speeds):
        return SpeedResult(tuple(runs), "none", (why,), speeds, throttles)
    fit, found = fit_speed(runs), throttle_coherence(runs)
    level, reasons = _judged(runs, fit, found)
    return SpeedResult(
        tuple(runs),
        level,
        reasons,
        speeds,
        throttles,
        fit,
        found,
        coasting(runs, fit) if level != "none" else None,
    )


def _unexcited(throttles: tuple[float, float], speeds: tuple[float, float, float]) -> str:
    swept, moved = throttles[1] - throttles[0], speeds[2] - speeds[0]
    if swept < LEAST_SPAN:
        return (
            f"no excitation: the throttle was swept by {100 * swept:.1f} % of its travel peak to peak, "
            f"at least {100 * LEAST_SPAN:.0f} % are needed; raise SWP_AMP"
        )
    if moved < LEAST_SPEED_SPAN:
        return (
            f"the speed changed by {moved:.2f} m/s peak to peak, which is hardly above the noise; "
            "raise SWP_AMP or lower SWP_WMIN"
        )
    return ""


def _judged(
    runs: Sequence[ThrottleRun], fit: SpeedFit, found: ThrottleCoherence
) -> tuple[str, tuple[str, ...]]:
    """The level, and the reasons for less than good."""
    bad = [f"the {name} is at the end of its range" for name in fit.at_bound if name != "delay"]
    if found.band is None or found.band[1] < LEAST_BAND * found.band[0]:
        band = (
            "nowhere" if found.band is None else f"from {found.band[0]:.2g} to {found.band[1]:.2g} rad/s only"
        )
        bad.append(
            f"low coherence: throttle and speed are coherent {band}; sweep with more amplitude, on level "
            "ground, without turning"
        )
    if fit.fit < FAIR_FIT:
        bad.append(
            f"the law explains {100 * fit.fit:.0f} % of the speed's variation, at least 70 % are needed"
        )
    for name in ("gain", "lag"):
        low, high = fit.intervals[name]
        if high - low > 2 * WIDE * getattr(fit.model, name):
            bad.append(f"the {name} is not identified: 90 % interval {low:.3g} to {high:.3g}; sweep longer")
    if bad:
        return "poor", tuple(bad)
    fair = [f"{run.name} was stopped early ({run.stopped})" for run in runs if run.stopped]
    if fit.fit < GOOD_FIT:
        fair.append(f"the law explains {100 * fit.fit:.0f} % of the speed's variation; 90 % would be good")
    return ("acceptable", tuple(fair)) if fair else ("good", ())
