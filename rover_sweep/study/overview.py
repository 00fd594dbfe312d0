"""Sentences on the whole study: how many findings came out, and the virtual rover."""

from __future__ import annotations

from math import degrees

from rover_sweep.study import findings, parameter_findings
from rover_sweep.study.findings import StudyFinding
from rover_sweep.study.virtual_study import Study


def all_findings(study: Study) -> tuple[StudyFinding, ...]:
    """Every published finding, tested."""
    return tuple(make(study) for make in (*findings.FOUND, *parameter_findings.FOUND))


def outcome_counts(found: tuple[StudyFinding, ...]) -> str:
    """How many findings came out, and which did not."""
    came = sum(f.outcome == "came out" for f in found)
    part = sum(f.outcome == "came out in part" for f in found)
    not_out = [f.key for f in found if f.outcome == "did not come out"]
    words = f"{came} of {len(found)} statements came out on this rover, {part} in part"
    return words + (f", {len(not_out)} did not ({', '.join(not_out)})." if not_out else ".")


def rover_sentences(study: Study) -> tuple[str, ...]:
    """The physics of the rover beyond the three structures, the firmware, and the assumptions."""
    q, turf, firmware = study.runs.asphalt, study.runs.grass, study.runs.firmware
    softer = 100 * (1 - turf.front_cornering_stiffness / q.front_cornering_stiffness)
    return (
        f"A nonlinear single track with roll and the body of Table 3 ({q.mass:g} kg, a "
        f"{q.cg_to_front_axle:g} m, b {q.cg_to_rear_axle:g} m). Its other physics is in none of the "
        f"three structures: tyres with a friction limit ({q.friction:g} of the load) and unequal axles "
        f"({q.front_cornering_stiffness:g} and {q.rear_cornering_stiffness:g} N/rad); a servo with "
        f"{1000 * q.servo_delay:.0f} ms of delay, {1000 * q.servo_lag:.0f} ms of lag and at most "
        f"{degrees(q.servo_rate_limit):.0f} deg/s; a speed that drops in corners; an uneven road; a "
        "velocity from an estimator.",
        f"The firmware is ArduRover as shipped: main loop {firmware.loop_hz} Hz, gyro low-pass "
        f"{firmware.gyro_filter_hz:g} Hz, accelerometer {firmware.accel_filter_hz:g} Hz. The applet's wave "
        "is computed once per loop and held.",
        "Assumed, because the paper does not give it: the servo, the scale from PWM to angle, the friction, "
        f"the road, the grass (tyres {softer:.0f} % softer, friction {turf.friction:g}, "
        f"{turf.road_force / q.road_force:.1f} times as rough), the amplitudes of the doublets, and that "
        "the published rover ran these filters.",
    )
