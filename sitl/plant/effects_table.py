"""The effects that a variant file may ask for: ids, parameters, units, ranges.

    [effects]
    steering_backlash = { b = 0.012 }
    tyre_relaxation = { sigma = 0.25 }

ISO axes (x forward, y left, z up), SI units, left steering angle positive. u is the road-wheel angle
commanded, d the true one, F a lateral axle force with the slip angle alpha and static load Fz, phi and p roll
angle and rate.

servo_lag             T [s]: T d' = u - d, the whole lag
servo_rate_limit      R [rad/s]: abs(d') <= R of the road wheel
steering_deadband     w [rad], half width, of the servo's error: T d' = dz(u - d); with of = "command" that
                      of the command, which has no memory: T d' = dz(u) - d
steering_backlash     b [rad], half the gap: play operator behind the servo
steering_nonlinearity c3 [1/rad2]: u (1 + c3 u2)
steering_asymmetry    e [-]: (1 + e) u to the left, (1 - e) u to the right
steering_trim         u0 [rad]: d = u - u0
transport_delay       T [s]: d(t) = u(t - T), the whole delay
clock_offset          T [s]: the records of the steering are stamped late by T, so the motion appears early
                      against it; with stream = "velocity" those of the velocity are stamped late by T
tyre_relaxation       sigma [m]: (sigma/V) F' + F = F0, both axles
tyre_saturation       mu [-]: F = mu Fz tanh(C alpha/(mu Fz)), both axles
load_transfer         k [-]: C (1 - k (a_y/g)2), both axles
front_rear_stiffness  ratio [-]: Cf/Cr, the sum of both as without it
tyre_slip             C [N/rad] of each axle, Izz [kg m2]
roll_dof              k_phi [N m/rad], b_phi [N m s/rad]
roll_steer            e [rad/rad]: d + e phi at the front wheels
suspension_friction   T [N m]: T sgn p against roll
speed_variation       D [s/m]: D a_y2 off V', in addition to the drag of turned wheels
imu_offset            x, z [m]: the IMU further forward, further up than imu_position
imu_tilt              roll, pitch, yaw [rad]: mounting angles, yaw first; roll gives a_y = g sin(roll) at rest
sensor_filter         gyro_hz, accel_hz [Hz]: second-order Butterworth low-pass before the autopilot's own
velocity_lag          T [s]: the whole first-order lag of the estimator's velocity
surface_change        ratio [-]: C of both axles after / before; t [s] on the plant's clock or distance [m]
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
    "servo_lag": {"T": _size(_LATE, " s")},
    "servo_rate_limit": {"R": _positive(_UNLIMITED, " rad/s")},
    "steering_deadband": {"w": _size(1.0, " rad")},
    "steering_backlash": {"b": _size(1.0, " rad")},
    "steering_nonlinearity": {"c3": _either(30.0, " 1/rad2")},
    "steering_asymmetry": {"e": _either(1.0)},
    "steering_trim": {"u0": _either(1.0, " rad")},
    "transport_delay": {"T": _size(_LATE, " s")},
    "clock_offset": {"T": _either(_LATE, " s")},
    "tyre_relaxation": {"sigma": _size(10.0, " m")},
    "tyre_saturation": {"mu": _positive(_UNLIMITED)},
    "load_transfer": {"k": _either(10.0)},
    "front_rear_stiffness": {"ratio": _positive(20.0)},
    "tyre_slip": {"C": _positive(1e6, " N/rad"), "Izz": _positive(1e5, " kg m2")},
    "roll_dof": {"k_phi": _positive(1e6, " N m/rad"), "b_phi": _size(1e5, " N m s/rad")},
    "roll_steer": {"e": _either(5.0, " rad/rad")},
    "suspension_friction": {"T": _size(1e3, " N m")},
    "speed_variation": {"D": _size(5.0, " s/m")},
    "imu_offset": {"x": _either(5.0, " m", optional=True), "z": _either(5.0, " m", optional=True)},
    "imu_tilt": {name: _either(1.6, " rad", optional=True) for name in ("roll", "pitch", "yaw")},
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


def _effect(name: str, entries: object, where: str) -> Mapping[str, float | str]:
    rules = PARAMETERS.get(name)
    if rules is None:
        raise ValueError(f"variant {where}: there is no effect {name}; there are {', '.join(PARAMETERS)}")
    texts = _TEXTS.get(name, ())
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
    if name == "surface_change" and ("t" in entries) == ("distance" in entries):
        raise ValueError(f"{place} needs either t [s] or distance [m]")
    if entries.get("stream", STREAMS[0]) not in STREAMS:
        raise ValueError(f"{place}: stream = {entries['stream']!r} must be one of {', '.join(STREAMS)}")
    if name == "steering_deadband" and entries.get("of", DEAD[0]) not in DEAD:
        raise ValueError(f"{place}: of = {entries['of']!r} must be one of {', '.join(DEAD)}")


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
