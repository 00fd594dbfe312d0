"""The proposal of the speed loop and the steering's limits as plain data for JSON."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Any

from rover_sweep.gains.speed_proposal import AssessedSpeed, SpeedProposal
from rover_sweep.gains.steering_limits import SteeringLimits


def speed_gains_document(proposal: SpeedProposal) -> dict[str, Any]:
    """The proposal; "proposed" is null if level is "none"; infinity is null."""
    return {
        "level": proposal.level,
        "reasons": list(proposal.reasons),
        "remarks": list(proposal.remarks),
        "speeds_m_s": list(proposal.found.speeds),
        "assumed_parameters": list(proposal.loop.assumed),
        "throttle_min_percent": proposal.throttle_min,
        "now": _assessed(proposal.now),
        "proposed": _assessed(proposal.proposed),
    }


def limits_document(limits: SteeringLimits) -> dict[str, Any]:
    """The steering's limits, with what they come from."""
    return {
        "parameters": {"ATC_STR_RAT_MAX": limits.rate_max, "ATC_TURN_MAX_G": limits.turn_g},
        "reach_deg_s": limits.reach,
        "confirmed_g": limits.confirmed_g,
    }


def _assessed(judged: AssessedSpeed | None) -> dict[str, Any] | None:
    if judged is None:
        return None
    numbers = {
        "gain_margin_db": judged.margins.gain_db,
        "phase_margin_deg": judged.margins.phase_deg,
        "worst_gain_margin_db": judged.worst_gain,
        "worst_phase_margin_deg": judged.worst_phase,
        "crossover_rad_s": judged.margins.crossover,
    }
    return {
        "parameters": judged.settings.parameters,
        **{name: _finite(value) for name, value in numbers.items()},
        "step": {name: _finite(value) for name, value in asdict(judged.step).items()},
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
