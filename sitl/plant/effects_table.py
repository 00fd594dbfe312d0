"""The effects that a variant file may ask for: ids, parameters, units, ranges.

    [effects]
    steering_backlash = { b = 0.012 }
    tyre_relaxation = { sigma = 0.25 }

A text parameter, as in `tyre_saturation = { mu = 0.7, form = "brush" }`, selects another law of the same
effect; the first of `FORMS` where it is not given.

ISO axes (x forward, y left, z up), SI units, left steering angle positive. u is the road-wheel angle
commanded, d the true one, F a lateral axle force with the slip angle alpha and static load Fz, phi and p roll
angle and rate.

servo_lag             T [s]: T d' = u - d, the whole lag; "second order" with q [-]: q T2 d'' + T d' + d = u
servo_rate_limit      R [rad/s]: abs(d') <= R of the road wheel
steering_deadband     w [rad], half width, of the servo's error: T d' = dz(u - d); with of = "command" that
                      of the command, which has no memory: T d' = dz(u) - d; "full travel", of the command
                      only: dz(u) = u outside of w
steering_stiction     s [rad]: d stays until abs(u - d) > s, then d = u; "with memory": then follows u until u
                      turns back
steering_backlash     b [rad], half the gap: play operator behind the servo; "smooth hysteresis": d = u - b z,
                      b z' = u' - abs(u') z
steering_nonlinearity c3 [1/rad2]: u (1 + c3 u2); "quadratic": u (1 + c3 abs(u) 0.3 rad)
steering_asymmetry    e [-]: (1 + e) u to the left, (1 - e) u to the right; "quadratic": u + e u2/(0.3 rad)
steering_trim         u0 [rad]: d = u - u0
steering_scale        s [-]: (1 + s) u; the vehicle file keeps the rad_per_us without it
steering_compliance   k [rad/N]: d - k F of the front axle
transport_delay       T [s]: d(t) = u(t - T), the whole delay
clock_offset          T [s]: the records of the steering are stamped late by T, so the motion appears early
                      against it; with stream = "velocity" those of the velocity are stamped late by T
tyre_relaxation       sigma [m]: (sigma/V) F' + F = F0, both axles
tyre_saturation       mu [-]: F = mu Fz tanh(z), z = C alpha/(mu Fz), both axles; "brush": F = mu Fz
                      (z - z2/3 + z3/27) up to z = 3; "falling peak": F = mu Fz sin(1.6 atan(z/1.6));
                      "knee": F = mu Fz z/(1 + z6)^(1/6)
load_transfer         k [-]: C (1 - k (a_y/g)2), both axles
tyre_speed            k [-]: C (V/V0)^-k with V0 = 1 m/s, both axles
front_rear_stiffness  ratio [-]: Cf/Cr, the sum of both as without it
tyre_slip             C [N/rad] of each axle, Izz [kg m2]
roll_dof              k_phi [N m/rad], b_phi [N m s/rad]
roll_steer            e [rad/rad]: d + e phi at the front wheels; "rear axle": e phi at the rear wheels
yaw_damping           c [N m s]: yaw moment -c r; "over r/V": -c r V0/V with V0 = 1 m/s
side_wind             w [m/s2], psi0 [rad], x [m]: side force m w cos(psi - psi0) to the left, at the
                      height of the CG, x ahead of it
suspension_friction   T [N m]: T sgn p against roll
speed_variation       D [s/m]: D a_y2 off V', in addition to the drag of turned wheels
imu_offset            x, z [m]: the IMU further forward, further up than imu_position
imu_tilt              roll, pitch, yaw [rad]: mounting angles, yaw first; roll gives a_y = g sin(roll) at rest
sensor_scale          gyro, accel [-]: measured = (1 + scale) true
sensor_filter         gyro_hz, accel_hz [Hz]: second-order Butterworth low-pass before the autopilot's own;
                      "first order"; "delay" of 1/(2 pi f); "first order, before the estimator" and "second
                      order, before the estimator": the estimator's heading integrates the filtered yaw rate
velocity_lag          T [s]: the whole first-order lag of the estimator's velocity; "delay": the velocity of
                      T ago
surface_change        ratio [-]: C of both axles after / before; t [s] on the plant's clock or distance [m],
                      from which on it stays; "over ten seconds" from t on; "all along" without either: ln C
                      grows by ln ratio in 300 s
cross_slope           b [rad], psi0 [rad]: the accelerometer reads g b cos(psi - psi0) more to the left (left
                      is uphill at psi0), psi left-positive from north; gravity pulls the other way
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass

Effects = Mapping[str, Mapping[str, float | str]]

STREAMS = ("steering", "velocity")
DEAD = ("error", "command")
ALL_ALONG = "all along"
BEFORE_ESTIMATOR = ", before the estimator"
FORMS: Mapping[str, tuple[str, ...]] = {
    "servo_lag": ("first order", "second order"),
    "steering_deadband": ("subtracted", "full travel"),
    "steering_stiction": ("no memory", "with memory"),
    "steering_backlash": ("play", "smooth hysteresis"),
    "steering_nonlinearity": ("cubic", "quadratic"),
    "steering_asymmetry": ("two slopes", "quadratic"),
    "tyre_saturation": ("tanh", "brush", "falling peak", "knee"),
    "roll_steer": ("front axle", "rear axle"),
    "yaw_damping": ("over r", "over r/V"),
    "velocity_lag": ("first order", "delay"),
    "sensor_filter": (
        "second order",
        "first order",
        "delay",
        f"first order{BEFORE_ESTIMATOR}",
        f"second order{BEFORE_ESTIMATOR}",
    ),
    "surface_change": ("from then on", "over ten seconds", ALL_ALONG),
}
"""Laws of an effect; the first where the file gives none."""


@dataclass(frozen=True)
class Rule:
    """A parameter: least value (excluded where `above`), largest, unit, and whether it may be left out."""

    low: float
    high: float
    unit: str = ""
    above: bool = False
    optional: bool = False

    @property
    def words(self) -> str:
        """The range in words."""
        if self.low < 0.0:
            return f"lie between {self.low:g} and {self.high:g}{self.unit}"
        least = "greater than" if self.above else "at least"
        return f"be {least} {self.low:g} and at most {self.high:g}{self.unit}"


def _either(high: float, unit: str = "", optional: bool = False) -> Rule:
    """Of either sign."""
    return Rule(-high, high, unit, optional=optional)


def _size(high: float, unit: str = "") -> Rule:
    """0 or more."""
    return Rule(0.0, high, unit)


def _positive(high: float, unit: str = "", optional: bool = False) -> Rule:
    """More than 0."""
    return Rule(0.0, high, unit, above=True, optional=optional)


# Largest values: no wheeled vehicle has more, and all that a diagnosis may find lies within. A rate limit, a
# friction or a cut-off of 1e5 limits nothing any more.
_UNLIMITED, _LATE = 1e5, 2.0

PARAMETERS: Mapping[str, Mapping[str, Rule]] = {
    "servo_lag": {"T": _size(_LATE, " s"), "q": _positive(10.0, optional=True)},
    "servo_rate_limit": {"R": _positive(_UNLIMITED, " rad/s")},
    "steering_deadband": {"w": _size(1.0, " rad")},
    "steering_stiction": {"s": _size(1.0, " rad")},
    "steering_backlash": {"b": _size(1.0, " rad")},
    "steering_nonlinearity": {"c3": _either(30.0, " 1/rad2")},
    "steering_asymmetry": {"e": _either(1.0)},
    "steering_trim": {"u0": _either(1.0, " rad")},
    "steering_scale": {"s": Rule(-0.9, 1.0)},
    "steering_compliance": {"k": _size(10.0, " rad/N")},
    "transport_delay": {"T": _size(_LATE, " s")},
    "clock_offset": {"T": _either(_LATE, " s")},
    "tyre_relaxation": {"sigma": _size(10.0, " m")},
    "tyre_saturation": {"mu": Rule(0.01, _UNLIMITED)},
    "load_transfer": {"k": _either(10.0)},
    "tyre_speed": {"k": _either(3.0)},
    "front_rear_stiffness": {"ratio": _positive(20.0)},
    "tyre_slip": {"C": _positive(1e6, " N/rad"), "Izz": _positive(1e5, " kg m2")},
    "roll_dof": {"k_phi": _positive(1e6, " N m/rad"), "b_phi": _size(1e5, " N m s/rad")},
    "roll_steer": {"e": _either(5.0, " rad/rad")},
    "yaw_damping": {"c": _size(1e6, " N m s")},
    "side_wind": {
        "w": _size(20.0, " m/s2"),
        "psi0": _either(6.3, " rad"),
        "x": _either(5.0, " m", optional=True),
    },
    "suspension_friction": {"T": _size(1e3, " N m")},
    "speed_variation": {"D": _size(5.0, " s/m")},
    "imu_offset": {"x": _either(5.0, " m", optional=True), "z": _either(5.0, " m", optional=True)},
    "imu_tilt": {name: _either(1.6, " rad", optional=True) for name in ("roll", "pitch", "yaw")},
    "sensor_scale": {name: _either(0.9, optional=True) for name in ("gyro", "accel")},
    "sensor_filter": {name: _positive(_UNLIMITED, " Hz", optional=True) for name in ("gyro_hz", "accel_hz")},
    "velocity_lag": {"T": _size(_LATE, " s")},
    "surface_change": {
        "ratio": _positive(20.0),
        "t": _either(1e5, " s", optional=True),
        "distance": Rule(0.0, 1e6, " m", optional=True),
    },
    "cross_slope": {"b": _either(0.6, " rad"), "psi0": _either(6.3, " rad")},
}
_TEXTS = {"clock_offset": ("stream",), "surface_change": ("run",), "steering_deadband": ("of",)}
_CHOICES = {"stream": STREAMS, "of": DEAD}


def checked(table: object, where: str) -> Effects:
    """The table `[effects]` of the file `where`, every number in order.

    Raises ValueError naming the wrong entry.
    """
    if not isinstance(table, dict):
        raise ValueError(f"variant {where}: effects = {table!r} must be a table [effects]")
    return {name: _effect(name, entries, where) for name, entries in table.items()}


def merged(inherited: Effects, own: Effects) -> Effects:
    """Effects of a base variant, replaced by those of the file where both have one."""
    return {**inherited, **own}


def number(effects: Effects, name: str, parameter: str, absent: float = 0.0) -> float:
    """A parameter of an effect, `absent` where it was not given."""
    return float(effects.get(name, {}).get(parameter, absent))


def form(effects: Effects, name: str) -> str:
    """The law of an effect that has forms."""
    return str(effects.get(name, {}).get("form", FORMS[name][0]))


def _effect(name: str, entries: object, where: str) -> Mapping[str, float | str]:
    rules = PARAMETERS.get(name)
    if rules is None:
        raise ValueError(f"variant {where}: there is no effect {name}; there are {', '.join(PARAMETERS)}")
    texts = (*_TEXTS.get(name, ()), *(("form",) if name in FORMS else ()))
    place = f"variant {where}: {name}"
    if not isinstance(entries, dict):
        raise ValueError(f"{place} = {entries!r} must be a table, as in: {name} = {{ {_example(rules)} }}")
    if unknown := [p for p in entries if p not in rules and p not in texts]:
        raise ValueError(
            f"{place} has no parameter {', '.join(unknown)}; it has {', '.join((*rules, *texts))}"
        )
    if missing := [p for p, rule in rules.items() if p not in entries and not rule.optional]:
        raise ValueError(f"{place} lacks {', '.join(missing)}, as in: {name} = {{ {_example(rules)} }}")
    _together(name, entries, place)
    return {
        p: _text(x, p, place) if p in texts else _value(x, p, rules[p], place) for p, x in entries.items()
    }


def _together(name: str, entries: Mapping[str, object], place: str) -> None:
    """Checks that need several parameters."""
    if not entries:
        raise ValueError(f"{place} is empty: give at least one of {', '.join(PARAMETERS[name])}")
    for choice, known in {**_CHOICES, "form": FORMS.get(name, ())}.items():
        if choice in entries and entries[choice] not in known:
            named = ", ".join(f'"{k}"' if " " in k else k for k in known)
            raise ValueError(f"{place}: {choice} = {entries[choice]!r} must be one of {named}")
    law = entries.get("form")
    if name == "surface_change" and ("t" in entries) + ("distance" in entries) != (law != ALL_ALONG):
        raise ValueError(
            f"{place} begins with the first run: leave out t and distance"
            if law == ALL_ALONG
            else f"{place} needs either t [s] or distance [m]"
        )
    if law == "over ten seconds" and "t" not in entries:
        raise ValueError(f"{place} over ten seconds needs t [s], not a distance")
    if name == "servo_lag" and ("q" in entries) != (law == "second order"):
        raise ValueError(f'{place}: q goes with form = "second order"')
    if law == "full travel" and entries.get("of") != "command":
        raise ValueError(f'{place}: the form full travel is of the command; give of = "command"')


def _text(value: object, name: str, place: str) -> str:
    if not isinstance(value, str):
        raise ValueError(f"{place}: {name} = {value!r} must be text")
    return value


def _value(value: object, name: str, rule: Rule, place: str) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not abs(value) <= sys.float_info.max:
        raise ValueError(f"{place}: {name} = {value!r} must be a finite number")
    if not rule.low <= value <= rule.high or (rule.above and value == rule.low):
        raise ValueError(f"{place}: {name} = {value} must {rule.words}")
    return float(value)


def _example(rules: Mapping[str, Rule]) -> str:
    return (
        ", ".join(f"{p} = .." for p, rule in rules.items() if not rule.optional)
        or f"{next(iter(rules))} = .."
    )
