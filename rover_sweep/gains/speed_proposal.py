"""Current and proposed settings of the speed loop with their margins and predicted steps."""

from __future__ import annotations

from dataclasses import dataclass, replace

from rover_sweep.gains.speed_chain import (
    BATTERY,
    IdentifiedSpeed,
    SpeedLoop,
    SpeedSettings,
    SpeedStep,
    cruise,
    design_speed,
    margins_of,
    step_ends,
    step_of_speed,
    without_dead_zone,
)
from rover_sweep.gains.tuning import MOST_OVERSHOOT, Margins

DEAD_ZONE = 0.05  # share of full above which MOT_THR_MIN is worth a remark


@dataclass(frozen=True)
class AssessedSpeed:
    """Settings assessed on the law. margins: as identified; worst_gain [dB], worst_phase [deg]: lowest within
    the intervals; step: as predicted."""

    settings: SpeedSettings
    margins: Margins
    worst_gain: float
    worst_phase: float
    step: SpeedStep


@dataclass(frozen=True)
class SpeedProposal:
    """Proposed settings, None if not supported, and the current ones. level: "gains", "cruise only" or
    "none"; reasons: why not more; remarks; tuned: the loop with the proposed MOT_THR_MIN."""

    found: IdentifiedSpeed
    loop: SpeedLoop
    level: str
    reasons: tuple[str, ...]
    remarks: tuple[str, ...] = ()
    now: AssessedSpeed | None = None
    proposed: AssessedSpeed | None = None
    tuned: SpeedLoop | None = None

    @property
    def throttle_min(self) -> float | None:
        """MOT_THR_MIN [%] that goes with the proposal, None if it stays."""
        if self.tuned is None or self.tuned.least == self.loop.least:
            return None
        return round(100 * self.tuned.least, 2)


def propose_speed(found: IdentifiedSpeed, loop: SpeedLoop) -> SpeedProposal:
    """Settings of the speed loop for the speeds that were swept."""
    plant = found.plant
    if plant is None or found.level not in ("good", "acceptable"):
        reasons = found.reasons or ("the response of the speed was not identified",)
        return SpeedProposal(found, loop, "none", reasons)
    now = assess_speed(found, loop, loop.now)
    tuned = without_dead_zone(loop, found)
    made = design_speed(tuned, found)
    if made is None:
        speed, percent = cruise(loop, plant, found.speeds[1])
        only = replace(loop.now, cruise_speed=speed, cruise_throttle=percent)
        why = "no P and I keep 6 dB and 45 deg within the intervals; reduce the delay, or sweep longer"
        return SpeedProposal(
            found, loop, "cruise only", (why,), _remarks(found, loop), now, assess_speed(found, loop, only)
        )
    judged = assess_speed(found, tuned, made)
    remarks = (*_remarks(found, tuned), *_overshoot(judged))
    return SpeedProposal(found, loop, "gains", (), remarks, now, judged, tuned)


def assess_speed(found: IdentifiedSpeed, loop: SpeedLoop, settings: SpeedSettings) -> AssessedSpeed:
    """Margins and step of one set of settings."""
    assert found.plant is not None
    every = margins_of(loop, list(found.family()), settings)
    return AssessedSpeed(
        settings,
        every[0],
        min(m.gain_db for m in every),
        min(m.phase_deg for m in every),
        step_of_speed(loop, found.plant, settings, *step_ends(found)),
    )


def _overshoot(judged: AssessedSpeed) -> tuple[str, ...]:
    if judged.step.overshoot <= MOST_OVERSHOOT + 0.5:
        return ()
    return (
        f"the predicted overshoot is {judged.step.overshoot:.0f} %, as the base throttle fits at one speed "
        "only and the delay limits P",
    )


def _remarks(found: IdentifiedSpeed, loop: SpeedLoop) -> tuple[str, ...]:
    plant = found.plant
    assert plant is not None
    low, _, high = found.speeds
    remarks = [
        f"valid from {low:.2f} to {high:.2f} m/s, the speeds of the sweeps; worst margins include a battery "
        f"{100 * BATTERY:.0f} % up or down"
    ]
    if plant.offset - loop.least > DEAD_ZONE:
        remarks.append(
            f"the rover needs {100 * plant.offset:.0f} % throttle before it moves: with MOT_THR_MIN "
            f"{100 * plant.offset:.0f} the base throttle is right at all speeds; then compute again"
        )
    if found.coasting is None:
        remarks.append("ATC_ACCEL_MAX assumes the drag under drive: no coasting was recorded after the sweep")
    remarks += [f"{name} = {value:g} is set but not included" for name, value in loop.not_modelled.items()]
    return tuple(remarks)
