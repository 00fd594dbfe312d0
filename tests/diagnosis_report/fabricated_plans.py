"""A plan made by hand."""

from __future__ import annotations

from rover_sweep.diagnosis.plans.expected_posterior import SimilarPair
from rover_sweep.diagnosis.plans.planner import DetectableSize, Plan, PlannedRun
from rover_sweep.diagnosis.result import Unseen

PLAN = Plan(
    runs=(PlannedRun("sweep", 150.0, 2.4, repeat=2), PlannedRun("doublet", 150.0, 2.4, 90.0)),
    detectable={
        "steering_backlash": DetectableSize("b", "rad", 0.0021, 0.003),
        "tyre_saturation": DetectableSize("mu", "-", 0.62, 0.9),
        "servo_rate_limit": DetectableSize("R", "rad/s", None),
    },
    look_alikes=(
        SimilarPair("tyre_relaxation", "transport_delay", 0.48),
        SimilarPair("tyre_saturation", "load_transfer", 0.31),
    ),
    cannot_see=(Unseen("cross_slope", "one heading"),),
    proposal=(PlannedRun("sweep", 240.0, 2.4), PlannedRun("bias_sweep", 100.0, 1.6, 180.0, 150.0)),
    settles=(
        "sweep of 240 us at 2.4 m/s: 0.5 bit of information; detects and separates tyre_relaxation",
        "sweep about a bias: 0.1 bit of information",
    ),
    notes=("no run is proposed beyond 3.9 m/s^2 of lateral acceleration",),
    proposed_look_alikes=(SimilarPair("tyre_saturation", "load_transfer", 0.23),),
    sentences=(
        "these runs cannot tell tyre relaxation from a delay, nor see the rate limit of the servo",
        "two more runs would",
    ),
)
