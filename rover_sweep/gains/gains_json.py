"""The proposal as plain data for JSON."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Any

from rover_sweep.gains.proposal import AssessedGains, Proposal


def gains_document(proposal: Proposal) -> dict[str, Any]:
    """The proposal; keys include units. "proposed" is null if `support.level` is "none"; infinity is null."""
    loop = proposal.autopilot
    document = {
        "format": "rover-sweep gains",
        "format_version": 1,
        "support": {
            "level": proposal.support.level,
            "reasons": list(proposal.support.reasons),
            "remarks": list(proposal.support.remarks),
        },
        "speed_m_s": proposal.speed,
        "holds_from_to_m_s": list(proposal.speed_range),
        "model": {
            "name": proposal.found.name,
            "level": proposal.found.level,
            "identified_at_m_s": list(proposal.found.speeds),
            "usable_band_of_r_rad_s": list(proposal.found.band) if proposal.found.band else None,
            "steady_r_per_angle_1_s": proposal.steady_gain,
            "delay_s": proposal.delay,
            "intervals_90": {name: list(ends) for name, ends in proposal.found.intervals.items()},
        },
        "autopilot": {
            "loop_rate_hz": loop.loop_hz,
            "gyro_filter_hz": loop.gyro_hz,
            "speed_scale_base_m_s": loop.scale_base,
            "speed_scale": loop.speed_scale(proposal.speed),
            "servo": loop.servo,
            "travel_us": {"right": loop.us_right, "left": loop.us_left},
            "assumed": list(loop.assumed),
        },
        "now": _judged(proposal.now),
        "proposed": _judged(proposal.proposed),
        "feed_forward_by_speed": [
            {"speed_m_s": v, "ATC_STR_RAT_FF": ff} for v, ff in (proposal.feed_forwards or {}).items()
        ],
    }
    found: dict[str, Any] = _finite(document)
    return found


def _judged(judged: AssessedGains | None) -> dict[str, Any] | None:
    if judged is None:
        return None
    (gain, gain_at), (phase, phase_at) = judged.worst_gain, judged.worst_phase
    return {
        "parameters": judged.gains.parameters,
        "gain_margin_db": judged.margins.gain_db,
        "phase_margin_deg": judged.margins.phase_deg,
        "crossover_rad_s": judged.margins.crossover,
        "phase_crossover_rad_s": judged.margins.phase_crossover,
        "worst": {
            "gain_margin_db": gain,
            "gain_margin_at": gain_at,
            "phase_margin_deg": phase,
            "phase_margin_at": phase_at,
        },
        "bandwidth_rad_s": judged.bandwidth,
        "steady_without_integrator": judged.steady,
        "step": {f"{k}{_UNITS[k]}": v for k, v in asdict(judged.step).items()},
    }


_UNITS = {
    "size": "_rad_s",
    "rise": "_s",
    "overshoot": "_percent",
    "settling": "_s",
    "lag": "_s",
    "used": "_of_travel",
}


def _finite(value: Any) -> Any:
    match value:
        case dict():
            return {k: _finite(v) for k, v in value.items()}
        case list():
            return [_finite(v) for v in value]
        case float():
            return value if math.isfinite(value) else None
    return value
