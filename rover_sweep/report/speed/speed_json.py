"""The response of the speed to the throttle as plain data, for speed.json."""

from __future__ import annotations

from typing import Any

from rover_sweep.identification.speed.coasting import Coasting
from rover_sweep.identification.speed.identify_speed import SpeedResult

_KEPT = ("CRUISE_", "ATC_SPEED_", "ATC_ACCEL", "ATC_DECEL", "ATC_BRAKE", "MOT_", "SCHED_LOOP_RATE")


def speed_document(result: SpeedResult) -> dict[str, Any]:
    """The result; keys include units. "law" is null without one; throttles are shares of full throttle."""
    fit, found, first = result.fit, result.coherence, result.runs[0]
    law = None
    if fit is not None:
        m = fit.model
        law = {"gain_m_s": m.gain, "lag_s": m.lag, "delay_s": m.delay, "offset": m.offset}
    return {
        "format": "rover-sweep speed",
        "format_version": 1,
        "runs": [run.name for run in result.runs],
        "sources": [list(source) for run in result.runs for source in run.sources],
        "level": result.level,
        "reasons": list(result.reasons),
        "speeds_m_s": list(result.speeds),
        "throttles": list(result.throttles),
        "neutral_us": first.neutral_us,
        "travel_us": first.travel_us,
        "law": law,
        "intervals": {name: list(ends) for name, ends in fit.intervals.items()} if fit else {},
        "fit": fit.fit if fit else None,
        "residual_m_s": fit.residual if fit else None,
        "band_rad_s": list(found.band) if found and found.band else None,
        "coherence": (
            {
                "w_rad_s": found.w.tolist(),
                "coherence": found.coherence.tolist(),
                "gain_m_s": found.gain.tolist(),
            }
            | {"phase_rad": found.phase.tolist()}
            if found
            else None
        ),
        "coasting": _coasting(result.coasting),
        "parameters": {n: v for n, v in sorted(first.parameters.items()) if n.startswith(_KEPT)},
    }


def _coasting(found: Coasting | None) -> dict[str, Any] | None:
    if found is None:
        return None
    return {
        "speed_m_s": found.speed,
        "deceleration_m_s2": found.deceleration,
        "interval_m_s2": list(found.interval),
        "seconds": found.seconds,
        "dead_zone": found.dead_zone,
        "dead_zone_interval": list(found.dead_zone_interval) if found.dead_zone_interval else None,
    }
