"""Diagnoses made by hand, one of each verdict, with overlays drawn from a noisy first-order rover."""

from __future__ import annotations

import numpy as np

from rover_sweep.data.results import Quantity
from rover_sweep.diagnosis.result import (
    Diagnosis,
    Falsified,
    Finding,
    Fit,
    HeldOut,
    LawCurve,
    LawHeldOut,
    Mismatch,
    Profile,
    TimeHistory,
    Unknown,
    Unseen,
)

NOISE = {"r": 0.012, "ay": 0.11, "p": 0.02}
GAIN = {"r": 0.6, "ay": 1.4, "p": 0.35}


def overlay(run: str, channel: str, held_out: bool, seconds: float = 24.0) -> TimeHistory:
    """Measured, a model that lags behind (before) and one that does not (after)."""
    t = np.arange(0.0, seconds, 0.02)
    phase = 2 * np.pi * (0.1 * t + 0.05 * t**2)
    noise = NOISE[channel] * np.random.default_rng(len(run) + len(channel)).standard_normal(t.size)
    clean = GAIN[channel] * np.sin(phase)
    w = np.geomspace(0.5, 25.0, 40)
    before = 1.0 + 60.0 / (1.0 + ((w - 9.0) / 4.0) ** 2)
    after = 1.0 + 0.3 * np.sin(w)
    late = GAIN[channel] * np.sin(phase - 0.35)
    return TimeHistory(
        run, channel, held_out, t, clean + noise, late, clean, NOISE[channel], w, before, after
    )


BEFORE_AFTER = (
    HeldOut("run4", Fit(4.21, 0.213), Fit(1.12, 0.058), 0.87),
    HeldOut(
        "run5", Fit(3.02, 0.184, {"r": 212.0, "ay": 96.0}), Fit(1.31, 0.081, {"r": 31.0, "ay": 40.0}), 0.71
    ),
)
BACKLASH = Finding(
    effect="steering_backlash",
    look_alikes=("steering_deadband",),
    parameters=(Quantity("b", "rad", 0.0083, 0.0071, 0.0094, "half the gap of the play"),),
    evidence={"gain": 412.0, "threshold": 21.4, "probability:steering_deadband": 0.31},
    held_out=BEFORE_AFTER,
    next_run="a servo test on blocks: 40 us at 0.5 rad/s, wheels off the ground",
    sentence="the steering has play of 0.017 rad from end to end (0.95 deg at the road wheels)",
    equation="d = play(u, b): d' = u' while |u - d| = b, else d' = 0",
)
RELAXATION = Finding(
    effect="tyre_relaxation",
    look_alikes=(),
    parameters=(Quantity("sigma", "m", 0.31, 0.24, None, "relaxation length, both axles"),),
    evidence={"gain": 55.0, "threshold": 18.0},
    held_out=(HeldOut("run4", Fit(1.12, 0.058), Fit(1.01, 0.055), 0.12),),
    next_run="",
    sentence="side force builds up over 0.31 m of rolling",
    equation="(sigma/V) F' + F = F0",
)
MISMATCHES = (
    Mismatch(
        "r",
        (0.5, 3.1),
        "120 us",
        6.3,
        "the yaw rate lacks 6.3 noise floors between 0.5 and 3.1 rad/s, most at 120 us",
        Profile("amplitude", "us", (120.0, 240.0), (6.3, 2.9)),
    ),
    Mismatch("ay", (4.0, 14.0), "throughout", 4.1, "a_y differs by 4.1 noise floors between 4 and 14 rad/s"),
    Mismatch(
        "r",
        (1.0, 9.0),
        "left turns",
        2.2,
        "left turns differ more than right ones",
        Profile("turn", "", ("left", "right"), (2.2, 1.1)),
    ),
)
OVERLAYS = tuple(
    overlay(run, channel, run == "run4") for run in ("run4", "run1") for channel in ("r", "ay", "p")
)
UNSEEN = (
    Unseen("front_rear_stiffness", "one speed only: Cf/Cr goes into C and I_zz (cosine 0.99)"),
    Unseen("cross_slope", "the runs have one heading"),
)
SCORES = {
    "steering_backlash": 412.0, "steering_deadband": 391.0, "servo_lag": 88.0, "transport_delay": 84.0,
    "tyre_relaxation": 55.0, "tyre_saturation": 3.1, "imu_offset": 1.2, "cross_slope": 0.0,
}  # fmt: skip
EXPLAINED = Diagnosis(
    verdict="explained",
    sentence="play in the steering of half a gap b = 0.0083 rad explains what the roll-yaw model misses",
    baseline="roll-yaw",
    mismatch=MISMATCHES,
    findings=(BACKLASH,),
    cannot_see=UNSEEN,
    falsified=(Falsified("Izz", "kg m^2", 0.0921, 0.0702), Falsified("tau", "s", 0.071, 0.031)),
    parameters=(
        Quantity("C", "N/rad", 39.2, 38.1, 40.3, "cornering stiffness of an axle"),
        Quantity("Izz", "kg m^2", 0.0702, 0.0681, 0.0725, "yaw inertia"),
        Quantity("b", "rad", 0.0083, 0.0071, 0.0094, "half the gap of the play"),
    ),
    scores=SCORES,
    overlays=OVERLAYS,
    held_out=BEFORE_AFTER,
    remarks=("the accelerometer's low-pass is not in the log of run2; 10 Hz was taken",),
    seconds=14.3,
    runs=("run1", "run2", "run3"),
    held_out_runs=("run4", "run5"),
)
KEPT = "the roll rate keeps 2.4 noise floors that the roll state predicts"
PARTLY = Diagnosis(
    verdict="partly explained",
    sentence="play in the steering and tyre relaxation explain most of it, something in p remains",
    baseline="roll-yaw",
    mismatch=MISMATCHES[:2],
    findings=(BACKLASH, RELAXATION),
    unknown=Unknown("p", "phi and p", 2.4, KEPT, "-0.31 phi^3", 0.62),
    scores=SCORES,
    overlays=OVERLAYS[:3],
    held_out=(HeldOut("run4", Fit(4.21, 0.213), Fit(1.01, 0.055), 0.89),),
    seconds=21.0,
    runs=("run1", "run2", "run3"),
    held_out_runs=("run4",),
)
CURVE = LawCurve(
    "yaw moment", ("side force rear",), "r", "rad/s", "N m", (-1.0, 0.0, 1.0),
    (0.7, 0.0, -0.7), (0.6, 0.0, -0.8), (0.8, 0.0, -0.6), 5120.0,
)  # fmt: skip
UNEXPLAINED = Diagnosis(
    verdict="unexplained",
    sentence="the yaw rate has a residual of 5 noise floors that no candidate explains",
    baseline="bicycle",
    mismatch=MISMATCHES[:1],
    unknown=Unknown(
        "r", "r and V", 5.0, "the residual of r follows r |r|", "yaw moment ~ r", 0.94, "yaw moment",
        ("side force rear",), (CURVE,), (LawHeldOut("run4", 4.6, 1.2, 0.056),), "a locked differential",
        "drive steady turns",
    ),
    scores={e: 0.1 * s for e, s in SCORES.items()},
    seconds=12.0,
    runs=("run1",),
)  # fmt: skip
NONE = Diagnosis(
    verdict="none",
    sentence="the roll-yaw model explains these runs down to the noise floor",
    baseline="roll-yaw",
    cannot_see=UNSEEN,
    scores={e: 0.01 * s for e, s in SCORES.items()},
    overlays=OVERLAYS[:3],
    held_out=(HeldOut("run4", Fit(1.01, 0.055), Fit(1.01, 0.055), None),),
    seconds=6.0,
    runs=("run1", "run2"),
    held_out_runs=("run4",),
)
REFUSED = Diagnosis("refused", "run1 has no steering to speak of: 3 us", "roll-yaw", runs=("run1",))
ALL = {d.verdict: d for d in (EXPLAINED, PARTLY, UNEXPLAINED, NONE, REFUSED)}
