"""What a catalogue of concealed laws is made of, and the laws of the list: from the literature, and sharing
no equation with the diagnosis. `outside_laws` has those that the list lacks.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from math import exp
from typing import Any

from numpy.random import Generator

from tests.foreign.plant import GRAVITY
from tests.foreign.rover import Rover

Extras = Mapping[str, float]  # numbers of a law that are drawn, not sized
Applied = Callable[[Rover, float, Extras], Rover]


def no_extras(_rng: Generator) -> dict[str, float]:
    """For a law whose size says all."""
    return {}


def a_sign(rng: Generator) -> dict[str, float]:
    """{"sign": -1 or 1}."""
    return {"sign": float(rng.choice([-1.0, 1.0]))}


def uniform(**ranges: tuple[float, float]) -> Callable[[Generator], dict[str, float]]:
    """Draws each number between its bounds."""
    return lambda rng: {name: float(rng.uniform(*bounds)) for name, bounds in ranges.items()}


def size_itself(_rover: Rover, size: float) -> float:
    """The value of a law whose size is its value."""
    return size


@dataclass(frozen=True)
class Law:
    """One law that may be concealed.

    effect: its id, "outside:..." where the list has none. form: which law. place: laws of one place are not
    concealed together. low, high: sizes, from more than a normal tolerance to the largest that a vehicle may
    have. apply(rover, size, extras) is monotonic in size. value: the size in the unit of
    `unit`. own: the form is that of the list's equation. absolute: judged by its size alone, since nominal
    parameters would take up all of it below a tolerance.
    """

    effect: str
    form: str
    place: str
    low: float
    high: float
    apply: Applied
    unit: str = "-"
    value: Callable[[Rover, float], float] = size_itself
    extras: Callable[[Generator], dict[str, float]] = field(default=no_extras)
    own: bool = False
    absolute: bool = False


def peak_ay(rover: Rover) -> float:
    """a_y [m/s^2] of a steady turn at the large amplitude, single track."""
    return rover.amplitude * rover.speed**2 / (rover.numbers.a + rover.numbers.b)


def turning_stiffness(rover: Rover) -> float:
    """a^2 Cf + b^2 Cr [N m/rad]; over the speed it is the yaw damping of the tyres [N m s/rad]."""
    n = rover.numbers
    return n.a**2 * n.Cf + n.b**2 * n.Cr


def share_of_base(rover: Rover, size: float) -> float:
    """A length [m] from its share of the wheelbase."""
    return size * (rover.numbers.a + rover.numbers.b)


def numbers(name: str, signed: bool = False, **others: float) -> Applied:
    """The size (with a drawn sign) as a number of the rover, others as they are."""
    return lambda rover, size, extras: rover.of(**{name: extras["sign"] * size if signed else size, **others})


def valued(name: str, value: Callable[[Rover, float], float], **others: float) -> Applied:
    """The value of a size as a number of the rover, others as they are."""
    return lambda rover, size, _extras: rover.of(**{name: value(rover, size), **others})


def instruments(name: str, about: float = 0.0, signed: bool = False, **others: Any) -> Applied:
    """The size (with a drawn sign) as a number of the instruments, from `about`; others as they are."""
    return lambda rover, size, extras: rover.sensing(
        **{name: about + (extras["sign"] * size if signed else size), **others}
    )


# ---- Laws of the list between the command and the road wheel.


def _angle(rover: Rover, size: float) -> float:
    return size * rover.amplitude


def _curve(form: float) -> Applied:
    loss = _cubic_value if form != 2.0 else lambda rover, size: size / (0.3 * rover.amplitude)
    return valued("curve", loss, curve_form=form)


def _cubic_value(rover: Rover, size: float) -> float:
    return size / rover.amplitude**2


def _asymmetry(form: float) -> Applied:
    def apply(rover: Rover, size: float, extras: Extras) -> Rover:
        e = size if form == 0.0 else size / (8.0 * rover.amplitude)
        return rover.of(asymmetry=extras["sign"] * e, asymmetry_form=form)

    return apply


def per_newton(rover: Rover, size: float) -> float:
    """Angle per front side force [rad/N]: the share `size` of the large amplitude is lost at its force."""
    n = rover.numbers
    return size * rover.amplitude / (n.m * peak_ay(rover) * n.b / (n.a + n.b))


def _second_order(rover: Rover, size: float, _extras: Extras) -> Rover:
    zeta = 0.6  # lag of 2 zeta/w in all
    return rover.of(gain=1 / size, motor_lag=size / (4 * zeta * zeta))


def _slowest(rover: Rover, size: float) -> float:
    return 25.0 * rover.amplitude / size


def _late(rover: Rover, size: float, _extras: Extras) -> Rover:
    return replace(rover, delay=size)


def _framed(rover: Rover, size: float, _extras: Extras) -> Rover:
    frame = 0.04
    return replace(rover, delay=size - frame / 2).amid(hold=frame)


_LOSSES = (  # field and its forms; the first is that of the list's equation
    ("steering_deadband", "deadband", ("dead zone", "jump at its edge", "soft")),
    ("steering_stiction", "stiction", ("held target", "drives until arrived", "drives above an error")),
    ("steering_backlash", "play", ("play", "play with spring", "Bouc-Wen", "Dahl")),
)
_CURVES = (("cubic", 0.6), ("crank", 0.25), ("exponent", 0.6), ("tanh", 0.6))
STEERING: tuple[Law, ...] = (
    *(
        Law(effect, form, "linkage", 0.03, 0.3, valued(name, _angle, **{f"{name}_form": k}), "rad", _angle,
            own=k == 0)
        for effect, name, forms in _LOSSES
        for k, form in enumerate(forms)
    ),
    *(
        Law("steering_nonlinearity", form, "shape", 0.06, high, _curve(float(k)), "1/rad^2", _cubic_value,
            own=k == 0)
        for k, (form, high) in enumerate(_CURVES)
    ),
    Law("steering_asymmetry", "two gains", "shape", 0.05, 0.4, _asymmetry(0.0), extras=a_sign, own=True),
    Law("steering_asymmetry", "quadratic", "shape", 0.05, 0.4, _asymmetry(1.0), extras=a_sign),
    Law("steering_compliance", "side force", "compliance", 0.08, 0.6, valued("compliance", per_newton,
        compliance_form=0),
        "rad/N", per_newton, own=True),
    Law("steering_compliance", "aligning moment", "compliance", 0.08, 0.6, valued("compliance", per_newton,
        compliance_form=1),
        "rad/N", per_newton),
    Law("steering_trim", "constant", "trim", 0.02, 0.09, numbers("trim", True), "rad", extras=a_sign,
        own=True,
        absolute=True),
    Law("servo_lag", "first order", "servo", 0.09, 0.17, valued("gain", lambda _, size: 1 / size), "s",
        own=True, absolute=True),
    Law("servo_lag", "second order", "servo", 0.09, 0.14, _second_order, "s", absolute=True),
    Law("transport_delay", "delay", "servo", 0.09, 0.15, _late, "s", own=True, absolute=True),
    Law("transport_delay", "delay and frame", "servo", 0.09, 0.15, _framed, "s", absolute=True),
    Law("servo_rate_limit", "limit", "servo", 1.05, 4.0, valued("rate", _slowest, rate_form=0), "rad/s",
        _slowest, own=True),
    Law("servo_rate_limit", "weak motor", "servo", 1.05, 4.0, valued("rate", _slowest, rate_form=1), "rad/s",
        _slowest),
)  # fmt: skip


# ---- Laws of the list in tyres, body, suspension and on the ground.


def friction_limit(rover: Rover, size: float) -> float:
    """Friction of tyres whose limit a steady turn at the large amplitude reaches 1/size of."""
    return peak_ay(rover) / GRAVITY / size


def _ratio(rover: Rover, size: float, _extras: Extras) -> Rover:
    """Softer in front: the other way a rover soon oversteers."""
    n = rover.numbers
    both, share = (n.Cf * n.Cr) ** 0.5, _front_over_rear(rover, size) ** 0.5
    return rover.of(Cf=both * share, Cr=both / share)


def _front_over_rear(_rover: Rover, size: float) -> float:
    return exp(-size)


_heading = uniform(heading=(-3.14, 3.14))


def _slope(rover: Rover, size: float, extras: Extras) -> Rover:
    return rover.of(slope=size, slope_heading=extras["heading"])


def _wind(rover: Rover, size: float, extras: Extras) -> Rover:
    base, h = rover.numbers.a + rover.numbers.b, rover.numbers.h
    blown = rover.of(wind_x=extras["lever"] * base, wind_z=h)
    return blown.amid(wind=size, wind_heading=extras["heading"], gusts=extras["gusts"])


def _blowing(rng: Generator) -> dict[str, float]:
    return _heading(rng) | {"lever": float(rng.uniform(-0.1, 0.15)), "gusts": float(rng.choice([0.0, 0.2]))}


def _moment(rover: Rover, size: float) -> float:
    return size * rover.numbers.ms * rover.numbers.h * peak_ay(rover)


def coupling(rover: Rover, size: float) -> float:
    """Of the rear wheels, N per unit of slip, that damps the yaw rate by a share of what the tyres do."""
    return 2 * size * turning_stiffness(rover) / rover.numbers.track**2


def damping(rover: Rover, size: float) -> float:
    """Of the yaw rate [N m s/rad], as a share of what the tyres do."""
    return size * turning_stiffness(rover) / rover.speed


def _instant(rng: Generator) -> dict[str, float]:
    return {"run": float(rng.choice([1.0, 2.0, 3.0])), "at": float(rng.uniform(12.0, 45.0))}


def _surface(form: str) -> Applied:
    def apply(rover: Rover, size: float, extras: Extras) -> Rover:
        where = {"run": int(extras["run"]), "at": extras["at"]} if extras else {}
        return rover.amid(surface=1 - size, surface_form=form, **where)

    return apply


def _later(rng: Generator) -> dict[str, float]:
    return {"run": float(rng.choice([2.0, 3.0])), "at": 0.0}


def _kept(_rover: Rover, size: float) -> float:
    return 1 - size


_SATURATING = ("Fiala", "Magic Formula", "tanh", "Dugoff", "arctangent", "exponential")
_CHANGES = (
    ("instant", _instant),
    ("ramp", _instant),
    ("later runs", _later),
    ("one run", _later),
    ("drift", no_extras),
)
VEHICLE: tuple[Law, ...] = (
    *(
        Law("tyre_saturation", name, "tyre", 0.3, 1.1, valued("mu", friction_limit, tyre_form=k + 1), "-",
            friction_limit, own=name == "tanh")
        for k, name in enumerate(_SATURATING)
    ),
    Law("load_transfer", "parabola", "tyre", 0.3, 4.0, numbers("load_k", load_form=1), own=True),
    Law("load_transfer", "sin 2 atan", "tyre", 0.5, 3.0, numbers("load_k", load_form=3)),
    Law("front_rear_stiffness", "ratio", "axles", 0.22, 0.5, _ratio, value=_front_over_rear, own=True),
    Law("tyre_relaxation", "both axles", "tyre", 0.2, 1.5, valued("sigma", share_of_base), "m",
        share_of_base, own=True),
    Law("tyre_relaxation", "front axle", "tyre", 0.3, 2.0, valued("sigma", share_of_base, sigma_form=2), "m",
        share_of_base),
    *(
        Law("suspension_friction", form, "roll", 0.05, 0.7, valued("friction", _moment, friction_form=k),
            "N m", _moment, own=k == 0)
        for k, form in enumerate(("tanh", "Stribeck", "soft"))
    ),
    Law("roll_steer", "front axle", "roll", 0.15, 1.0, numbers("roll_steer_front", True), "rad/rad",
        extras=a_sign, own=True),
    Law("roll_steer", "rear axle", "roll", 0.15, 1.0, numbers("roll_steer_rear", True), "rad/rad",
        extras=a_sign),
    Law("yaw_damping", "moment", "yaw", 0.1, 1.2, valued("yaw_c", damping), "N m s/rad", damping, own=True),
    Law("yaw_damping", "locked wheels", "yaw", 0.1, 1.2, valued("diff_c", coupling), "N m s/rad", damping),
    Law("cross_slope", "plane", "ground", 0.025, 0.13, _slope, "rad", extras=_heading, own=True),
    Law("side_wind", "force by heading", "ground", 0.25, 1.5, _wind, "m/s^2", extras=_blowing, own=True),
    *(
        Law("surface_change", form, "ground", 0.12, 0.45, _surface(form), "-", _kept, draw, form == "instant")
        for form, draw in _CHANGES
    ),
)  # fmt: skip


# ---- Laws of the list in the instruments.


def _tilt(about: int) -> Applied:
    def apply(rover: Rover, size: float, extras: Extras) -> Rover:
        angles = list(rover.instruments.tilt)
        angles[about] += extras["sign"] * size
        return rover.sensing(tilt=tuple(angles))

    return apply


def _forward(rover: Rover, size: float, extras: Extras) -> Rover:
    return rover.sensing(imu_x=rover.instruments.imu_x + extras["sign"] * share_of_base(rover, size))


def _up(rover: Rover, size: float, extras: Extras) -> Rover:
    return rover.sensing(imu_z=rover.instruments.imu_z + extras["sign"] * share_of_base(rover, size))


SENSORS: tuple[Law, ...] = (
    Law("imu_tilt", "roll", "imu", 0.06, 0.2, _tilt(0), "rad", extras=a_sign, own=True, absolute=True),
    Law("imu_tilt", "pitch", "imu", 0.06, 0.2, _tilt(1), "rad", extras=a_sign, own=True),
    *(
        Law("sensor_filter", f"gyros {form}", "imu", 0.02, 0.12, instruments("gyro_lag", gyro_form=form), "s",
            own=form == "second order")
        for form in ("second order", "first order", "delay")
    ),
    Law("sensor_filter", "accelerometer first order", "imu", 0.02, 0.12, instruments("accel_lag"), "s"),
    Law("sensor_scale", "gyros", "imu", 0.06, 0.35, instruments("gyro_scale", 1.0, True), extras=a_sign,
        own=True),
    Law("sensor_scale", "accelerometer", "imu", 0.06, 0.35, instruments("accel_scale", 1.0, True),
        extras=a_sign),
    Law("imu_offset", "forward", "imu", 0.06, 0.5, _forward, "m", share_of_base, extras=a_sign, own=True),
    Law("imu_offset", "up", "imu", 0.06, 0.4, _up, "m", share_of_base, extras=a_sign, own=True),
    Law("velocity_lag", "first order", "ekf", 0.03, 0.3, instruments("velocity_lag"), "s", own=True),
    Law("velocity_lag", "delay", "ekf", 0.03, 0.3, instruments("velocity_lag", velocity_form="delay"), "s"),
)  # fmt: skip
LISTED: tuple[Law, ...] = (*STEERING, *VEHICLE, *SENSORS)
