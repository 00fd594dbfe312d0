"""The limits of the steering amplitude of a rover: applet, servo and tyres, each with its name."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from rover_sweep.data.geometry import FRICTION, GRAVITY, NEAR
from rover_sweep.data.recording import Array
from rover_sweep.data.vehicle_file import Vehicle
from rover_sweep.design.demand import HORN_DEG_PER_US, SERVO_60_DEG
from rover_sweep.logs.log import STEERING, output_channel, output_limits
from rover_sweep.quality.coherence import SERVO_TRAVEL, WHEEL_LOCK
from rover_sweep.spectra.amplitude import Limit
from rover_sweep.spectra.response import FrequencyResponse

MARGIN = 0.9  # share of the rate at which the applet stops a run


def limits_of(
    found: Mapping[str, FrequencyResponse],
    speed: float,
    parameters: Mapping[str, float],
    scale: float = 1.0,
    middle: float = 0.0,
    vehicle: Vehicle | None = None,
    servo_60_deg: float | None = None,
) -> tuple[Limit, ...]:
    """The limits [us] on the grid of the responses.

    speed [m/s] of the run; parameters: of the vehicle, as far as they are known; scale: input unit of the
    responses per us; middle: offset from trim about which is steered [us]; servo_60_deg: s that the
    servo takes for 60 deg of its horn, by its data sheet (a quick one where not given).
    """
    if not found:
        return ()
    w = next(iter(found.values())).w
    return tuple(
        Limit(words, w, np.broadcast_to(np.maximum(us - abs(middle), 1.0), w.shape))
        for words, us in (
            *_travel(parameters),
            *_servo(w, servo_60_deg),
            *_tyres(found, speed, scale, vehicle),
            *_applet(found, parameters, scale),
        )
    )


def limits_of_wheels(
    found: Mapping[str, FrequencyResponse], speed: float, driven: float, vehicle: Vehicle | None = None
) -> tuple[Limit, ...]:
    """The limits [rad] of a recording that holds the wheels' angle and no servo output. driven: its own."""
    if not found:
        return ()
    w = next(iter(found.values())).w
    scale = vehicle.rad_per_us.value if vehicle and vehicle.rad_per_us else None
    lock = max(WHEEL_LOCK if scale is None else abs(scale) * SERVO_TRAVEL, driven)
    words = f"the wheels' lock (about {lock:.2g} rad{', assumed' if scale is None else ''})"
    return tuple(
        Limit(said, w, np.broadcast_to(rad, w.shape))
        for said, rad in ((words, np.array(lock)), *_tyres(found, speed, 1.0, vehicle))
    )


def _travel(parameters: Mapping[str, float]) -> Iterator[tuple[str, Array]]:
    if "SWP_PWM_MAX" in parameters:
        yield "SWP_PWM_MAX", np.array(parameters["SWP_PWM_MAX"])
    channel = output_channel(parameters, STEERING) or 1
    if (ends := output_limits(parameters, channel)) is not None:
        trim = parameters.get(f"SERVO{channel}_TRIM", sum(ends) / 2)
        yield f"the end stop (SERVO{channel}_MIN and _MAX)", np.array(min(ends[1] - trim, trim - ends[0]))
    else:
        yield (
            f"a servo's usual travel ({SERVO_TRAVEL:.0f} us, as no SERVOn_MIN was recorded)",
            np.array(SERVO_TRAVEL),
        )


def _servo(w: Array, own: float | None) -> Iterator[tuple[str, Array]]:
    """The rate of a sine of amplitude A is A w."""
    seconds = own or SERVO_60_DEG[0]
    words = f"your servo ({own:g} s/60 deg)" if own else f"even a quick servo ({seconds:g} s/60 deg)"
    yield words, 60 / seconds / HORN_DEG_PER_US / w


def _tyres(
    found: Mapping[str, FrequencyResponse], speed: float, scale: float, vehicle: Vehicle | None
) -> Iterator[tuple[str, Array]]:
    """The side force that V r needs, up to the share of the friction above which runs get a warning."""
    stated = vehicle.friction.value if vehicle and vehicle.friction else None
    friction = stated or FRICTION
    if "r" in found and np.isfinite(speed) and speed > 0:
        words = f"the tyres' grip at {speed:.1f} m/s (friction {friction:g}{'' if stated else ', assumed'})"
        yield words, NEAR * friction * GRAVITY / (speed * _answer(found["r"], scale))


def _applet(
    found: Mapping[str, FrequencyResponse], parameters: Mapping[str, float], scale: float
) -> Iterator[tuple[str, Array]]:
    """The rates at which the applet stops the run."""
    for output, name in (("r", "SWP_R_MAX"), ("p", "SWP_P_MAX")):
        if output in found and name in parameters:
            yield name, MARGIN * np.radians(parameters[name]) / _answer(found[output], scale)


def _answer(f: FrequencyResponse, scale: float) -> Array:
    """Coherent output per us (n_w,)."""
    return np.asarray(np.maximum(np.abs(f.h) * np.sqrt(f.coherence) * abs(scale), 1e-9))
