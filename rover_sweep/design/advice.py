"""Advice on a design: warnings and remarks as sentences."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

from firmware_params.applet_parameters import PARAMETERS
from rover_sweep.data.geometry import GRAVITY
from rover_sweep.data.recording import Note
from rover_sweep.design.demand import (
    APPLET_RATE,
    FRICTION,
    HORN_DEG_PER_US,
    LEAST_SAMPLES,
    SERVO_60_DEG,
    SERVO_FRAMES,
    TRIM_ERROR,
    Design,
)
from rover_sweep.errors import UsageError
from rover_sweep.manoeuvre.sweep import BiasSweep, Sweep

# Long periods in T_rec, so that a window of at most T_rec/2 holds one. Tischler & Remple (2012) advise 4..5
# in all: the paper's sweep has 2.6, and is driven two or three times.
LEAST_PERIODS = 2.0
WEAK_AMPLITUDE, LARGE_AMPLITUDE = 50.0, 350.0  # us
PWM_MAX = next(p.default for p in PARAMETERS if p.name == "SWP_PWM_MAX")
NONSENSE_G, NONSENSE_WHEEL = 3.0, 45.0  # g, deg: impossible for tyres and steering
WEAK_YAW_RATE, GOOD_YAW_RATE = 10.0, 40.0  # deg/s; the paper's rover reached 40..45


def with_advice(design: Design, servo_60_deg: float | None = None) -> Design:
    """The design with its notes. servo_60_deg: time of the rover's servo for 60 deg [s]."""
    notes = (*_sweep(design), *_amplitude(design), *_servo(design, servo_60_deg), *_space(design))
    return replace(design, notes=(*notes, *_rates(design), *_filters(design)))


def refuse_nonsense(design: Design) -> None:
    """UsageError for a design that no rover can drive, probably due to a wrong unit."""
    space, wheel = design.space, design.servo.wheel_deg
    if wheel is not None and wheel > NONSENSE_WHEEL:
        raise UsageError(
            f"{design.manoeuvre.peak:g} us would turn the road wheels by {wheel:.0f} deg, more than "
            "any steering allows; check rad_per_us in the vehicle file, or reduce the amplitude"
        )
    if space is not None and space.ay > NONSENSE_G * GRAVITY:
        raise UsageError(
            f"{space.ay / GRAVITY:.0f} g of lateral acceleration at {space.speed:g} m/s, but tyres hold "
            f"{FRICTION[0]:g}..{FRICTION[1]:g} g; check the speed (m/s), the wheelbase and rad_per_us, or "
            "reduce the amplitude"
        )


def _sweep(design: Design) -> Iterator[Note]:
    sweep, windows = design.manoeuvre, design.windows
    if not isinstance(sweep, Sweep) or windows is None:
        return
    periods, longest = design.long_periods or 0.0, 2 * math.pi / sweep.w_min
    if periods < LEAST_PERIODS:
        yield Note(
            "warning",
            f"T_rec {sweep.t_rec:g} s contains {periods:.1f} periods of {sweep.w_min:g} rad/s, "
            f"but {LEAST_PERIODS:g} are needed, since a window is at most T_rec/2: use T_rec "
            f"{math.ceil(LEAST_PERIODS * longest)} s or w_min "
            f"{math.ceil(100 * LEAST_PERIODS * 2 * math.pi / sweep.t_rec) / 100:g} rad/s.",
        )
    elif windows.t_max < longest:
        needed = math.ceil(5 * longest / (sweep.duration - 2 * sweep.straight))
        runs = "one run" if design.runs == 1 else f"{design.runs} runs"
        yield Note(
            "warning",
            f"with {runs} of this sweep windows up to {windows.t_max:.0f} s are advised, "
            f"too short for {sweep.w_min:g} rad/s ({longest:.0f} s): drive {needed} runs.",
        )
    if sweep.fade == 0:
        yield Note(
            "warning", "without a fade the wave ends in a step, which the servo cannot follow: use 1..2 s."
        )
    if sweep.straight < 2:
        yield Note(
            "warning",
            "less than 2 s straight before and after the sweep is too short to measure biases and the "
            "noise floor: use 2 s or more.",
        )


def _amplitude(design: Design) -> Iterator[Note]:
    amplitude, peak = design.manoeuvre.amplitude, design.manoeuvre.peak
    if amplitude < WEAK_AMPLITUDE:
        yield Note(
            "warning",
            f"{amplitude:g} us is small: play in the steering and the servo's dead band (2..8 us) "
            f"affect the result; use {WEAK_AMPLITUDE:g} us or more.",
        )
    elif peak > LARGE_AMPLITUDE:
        yield Note(
            "warning",
            f"{peak:g} us is near the end stops of most steerings (500 us or less): check "
            f"that the linkage moves freely that far, and set SWP_PWM_MAX to {peak:g}.",
        )
    elif peak > PWM_MAX:
        yield Note(
            "warning",
            f"{peak:g} us is above SWP_PWM_MAX ({PWM_MAX:g} us by default): the applet refuses it "
            "until SWP_PWM_MAX is raised.",
        )


def _servo(design: Design, own: float | None) -> Iterator[Note]:
    horn, (quick, slow) = design.servo.horn_deg_s, SERVO_60_DEG
    if horn is None or horn <= 60 / (own or slow):
        return
    limit, hint = 60 / (own or slow), ""
    if own:
        servo = f"your servo ({own:g} s/60 deg)"
    elif horn > 60 / quick:
        servo, limit = f"even a fast servo ({quick:g} s/60 deg)", 60 / quick
    else:
        servo = f"a slow servo ({slow:g} s/60 deg)"
        hint = " Give --servo with the value of the data sheet to check yours."
    yield Note(
        "warning",
        f"at {HORN_DEG_PER_US:g} deg/us the horn must turn at {horn:.0f} deg/s at the end of the "
        f"sweep; {servo} reaches {limit:.0f} deg/s and would reduce the amplitude. "
        f"{limit / HORN_DEG_PER_US / design.w_top:.0f} us is possible.{hint}",
    )


def _space(design: Design) -> Iterator[Note]:
    space = design.space
    if space is None:
        return
    share = space.ay / GRAVITY
    if share > FRICTION[1]:
        yield Note(
            "warning",
            f"{share:.2f} g of lateral acceleration: the tyres will slide on any ground. Reduce "
            f"the speed or the amplitude.",
        )
    elif share > FRICTION[0]:
        yield Note(
            "warning",
            f"{share:.2f} g of lateral acceleration: the tyres slide on loose or wet ground and are far "
            f"from linear on asphalt.",
        )
    elif share > FRICTION[0] / 2:
        yield Note(
            "info",
            f"{share:.2f} g of lateral acceleration: good on dry asphalt; on loose ground the "
            f"tyres leave their linear range.",
        )
    if space.yaw_rate_deg_s < WEAK_YAW_RATE:
        more = design.manoeuvre.amplitude * GOOD_YAW_RATE / space.yaw_rate_deg_s
        yield Note(
            "warning",
            f"only {space.yaw_rate_deg_s:.1f} deg/s of yaw rate, near the noise of a small IMU: "
            f"about {more:.0f} us would give {GOOD_YAW_RATE:g} deg/s.",
        )
    if isinstance(design.manoeuvre, BiasSweep):
        circle = f"the rover drives in circles because of the bias: {space.length:.0f} x {space.width:.0f} m."
        yield Note("info", circle)
    elif space.heading_deg > 180:
        yield Note(
            "info",
            f"the slow part turns the rover by {space.heading_deg:.0f} deg, and it ends "
            f"{abs(space.heading_end_deg):.0f} deg to the "
            f"{'left' if space.heading_end_deg > 0 else 'right'} of its initial heading. A higher w_min, a "
            "lower speed or a smaller amplitude keeps it on a lane.",
        )
    yield Note(
        "info",
        f"nobody steers during the run: with a trim error of {TRIM_ERROR:g} us the rover gets up to "
        f"{space.farthest:.0f} m away from its start. Keep that circle free, and a hand on the switch.",
    )


def _rates(design: Design) -> Iterator[Note]:
    rates, hertz = design.rates, design.w_top / (2 * math.pi)
    needed = rates.loop_needed
    remedy = f"set SCHED_LOOP_RATE {needed} and reboot" if needed else "no loop rate is enough"
    if rates.stream < rates.good:
        yield Note(
            "warning" if rates.stream < rates.least else "info",
            f"at SCHED_LOOP_RATE {rates.loop:g} telemetry reaches {rates.stream:.0f} Hz, or "
            f"{rates.stream / hertz:.0f} samples in a period of {hertz:.1f} Hz; {rates.good:.0f} Hz are "
            f"good: {remedy}. The vehicle answers DENIED to a request for a higher rate.",
        )
    if hertz * LEAST_SAMPLES > SERVO_FRAMES:
        yield Note(
            "warning",
            f"{hertz:.1f} Hz is too high for the output of the wave: servo frames at "
            f"{SERVO_FRAMES:g} Hz, the applet at about {APPLET_RATE:g} Hz. Stay below "
            f"{2 * math.pi * SERVO_FRAMES / LEAST_SAMPLES:.0f} rad/s.",
        )


def _filters(design: Design) -> Iterator[Note]:
    strong = [effect for effect in design.filters if effect.lag_deg > 30 or effect.gain < 0.9]
    for effect in strong:
        yield Note(
            "warning",
            f"{effect.parameter} {effect.cutoff_hz:g} Hz has a lag of {effect.lag_deg:.0f} deg "
            f"({effect.lag_ms:.0f} ms) at {design.w_top:.0f} rad/s and a gain of {100 * effect.gain:.0f} %: "
            f"raise it to {effect.advised_hz:g} Hz.",
        )
    if strong:
        yield Note(
            "info",
            "identify corrects for a filter that it finds in the log, but an error of this correction "
            "changes the delay, tyre stiffness and inertia: keep the correction small.",
        )
