"""Laws of physics that the list does not have."""

from __future__ import annotations

from numpy.random import Generator

from tests.foreign.laws import (
    Applied,
    Extras,
    Law,
    a_sign,
    instruments,
    numbers,
    peak_ay,
    per_newton,
    share_of_base,
    turning_stiffness,
    uniform,
    valued,
)
from tests.foreign.plant import GRAVITY
from tests.foreign.rover import Rover

SWING, LAG, PERIOD = uniform(w=(4.5, 9.0)), uniform(lag=(0.1, 0.25)), uniform(period=(0.6, 1.6))


def _resonant(rover: Rover, size: float, extras: Extras) -> Rover:
    return rover.of(resonance_w=1 / size, resonance_z=extras["damping"])


def _cubic_hysteresis(rover: Rover, size: float, _extras: Extras) -> Rover:
    return rover.of(curve=size / rover.amplitude**2, play=0.4 * size * rover.amplitude, play_form=2.0)


def _mast(rover: Rover, size: float, extras: Extras) -> Rover:
    return rover.sensing(mast=size, mast_w=extras["w"])


def _drag(rover: Rover, size: float) -> float:
    fastest = peak_ay(rover) / rover.speed
    return size * turning_stiffness(rover) / rover.speed / fastest


def _shifted(rover: Rover, size: float, extras: Extras) -> Rover:
    shift = extras["sign"] * share_of_base(rover, size)
    return rover.amid(shift=shift, run=int(extras["run"]), at=extras["at"])


def _instant(rng: Generator) -> dict[str, float]:
    return a_sign(rng) | {"run": float(rng.choice([1.0, 2.0])), "at": float(rng.uniform(10.0, 40.0))}


def _slosh(rover: Rover, size: float, extras: Extras) -> Rover:
    return rover.of(loose=size, loose_w=extras["w"], loose_z=0.1)


def _by_speed(rover: Rover, size: float, extras: Extras) -> Rover:
    return rover.of(speed_gain=extras["sign"] * size, speed_ref=rover.speed)


def _dead_slip(rover: Rover, size: float) -> float:
    n = rover.numbers
    return size * n.m * peak_ay(rover) / (n.Cf + n.Cr)


def _loose(form: float) -> Applied:
    def apply(rover: Rover, size: float, extras: Extras) -> Rover:
        return rover.of(loose=size, loose_form=form, loose_w=extras.get("w", 1.0), loose_z=0.08)

    return apply


def _toe(rover: Rover, size: float, extras: Extras) -> Rover:
    return rover.of(compliance=per_newton(rover, size), compliance_lag=extras["lag"])


def _sliding_speed(rover: Rover, size: float, _extras: Extras) -> Rover:
    return rover.of(slip_speed=size, speed_ref=rover.speed)


def third_run(_rng: Generator) -> dict[str, float]:
    """The run in which it acts, at another speed."""
    return {"run": 3.0}


def _stops(rover: Rover, size: float, extras: Extras) -> Rover:
    return rover.of(bump=touching(rover, size), bump_k=extras["stiffer"] * rover.numbers.kphi)


def touching(rover: Rover, size: float) -> float:
    """Roll angle [rad] at which stops touch: 1/size of a steady turn's at the large amplitude."""
    n = rover.numbers
    return n.ms * n.h * peak_ay(rover) / (n.kphi - n.ms * GRAVITY * n.h) / size


def _lifting(rover: Rover, size: float, extras: Extras) -> Rover:
    return rover.of(lift=size / _moved(rover), lift_form=extras["axle"])


def _moved(rover: Rover) -> float:
    """Share of its load that an inner wheel loses in a steady turn at the large amplitude."""
    n = rover.numbers
    return 2 * peak_ay(rover) / GRAVITY * (n.h + n.roll_axis) / n.track


def lifting_ay(rover: Rover, size: float) -> float:
    """a_y [m/s^2] at which an inner wheel has no load: 1/size of a steady turn's at the large amplitude."""
    return peak_ay(rover) / size


def _axle(rng: Generator) -> dict[str, float]:
    return {"axle": float(rng.integers(2))}


def _limping(rover: Rover, size: float, extras: Extras) -> Rover:
    return rover.amid(limp=extras["sign"] * _limp(rover, size), limp_period=extras["period"])


def _limp(rover: Rover, size: float) -> float:
    """Yaw moment [N m] of one side that brakes with the share `size` of the weight."""
    return size * rover.numbers.m * GRAVITY * rover.numbers.track / 2


def _period(rng: Generator) -> dict[str, float]:
    return a_sign(rng) | PERIOD(rng)


def _tone(rover: Rover, size: float, extras: Extras) -> Rover:
    return rover.sensing(tone=size, tone_hz=extras["hz"])


OUTSIDE_LAWS: tuple[Law, ...] = (
    Law("outside:resonant_linkage", "second order", "linkage", 0.02, 0.045, _resonant, "s",
        extras=uniform(damping=(0.08, 0.2))),
    Law("outside:cubic_hysteresis", "cubic and Bouc-Wen", "linkage", 0.1, 0.6, _cubic_hysteresis),
    Law("outside:flexing_mast", "resonant IMU", "imu", 0.0004, 0.03, _mast, "rad", extras=uniform(w=(13.0,
        24.0))),
    Law("outside:yaw_drag", "r abs(r)", "yaw", 0.1, 2.0, valued("yaw_c2", _drag), "N m s2", _drag),
    Law("outside:tyre_left_right", "sign of slip", "tyre", 0.06, 0.6, numbers("tyre_left_right", True),
        extras=a_sign),
    Law("outside:sliding_cargo", "CG jumps", "cargo", 0.03, 0.13, _shifted, "m", share_of_base, _instant),
    Law("outside:slosh", "load on a spring", "cargo", 0.05, 0.35, _slosh, extras=uniform(w=(5.0, 11.0))),
    Law("outside:speed_steering", "gain by speed", "shape", 0.15, 0.8, _by_speed, extras=a_sign),
    Law("outside:tyre_dead_zone", "no force at small slip", "tyre", 0.06, 0.5, valued("tyre_dead_zone",
        _dead_slip), "rad",
        _dead_slip),
    Law("outside:aliased_vibration", "wandering tone", "imu", 0.1, 2.5, _tone, "m/s^2",
        extras=uniform(hz=(0.8, 3.5))),
    Law("outside:wheel_unbalance", "sine at wheel speed", "imu", 0.2, 4.0, instruments("unbalance"), "m/s^2"),
    Law("outside:rear_linkage", "rear wheels follow", "axles", 0.1, 0.4, numbers("rear_share", True),
        extras=a_sign),
    Law("outside:pendulum", "hanging load", "cargo", 0.04, 0.35, _loose(1.0), extras=SWING),
    Law("outside:sliding_load", "dry friction and stops", "cargo", 0.04, 0.35, _loose(2.0)),
    Law("outside:toe_compliance", "slow bushings", "compliance", 0.1, 0.8, _toe, "rad/N", per_newton, LAG),
    Law("outside:slip_speed", "force over sliding speed", "tyre", 0.7, 1.0, _sliding_speed,
        extras=third_run, absolute=True),
    Law("outside:bump_stops", "stiffer beyond an angle", "roll", 1.2, 3.0, _stops, "rad", touching,
        uniform(stiffer=(1.5, 6.0))),
    Law("outside:wheel_lift", "load to zero", "tyre", 0.8, 2.0, _lifting, "m/s^2", lifting_ay, _axle),
    Law("outside:limping_motor", "yaw moment", "yaw", 0.01, 0.2, _limping, "N m", _limp, _period),
)  # fmt: skip
