"""Laws of the list in tyres, body, suspension and on the ground."""

from __future__ import annotations

from math import exp

from numpy.random import Generator

from tests.foreign.chassis import GRAVITY
from tests.foreign.law import Applied, Extras, Law, a_sign, peak_ay, share_of_base, turning_stiffness
from tests.foreign.rover import Rover


def _tyre(form: int) -> Applied:
    def apply(rover: Rover, size: float, _extras: Extras) -> Rover:
        return rover.of(mu=_friction(rover, size), tyre_form=form)

    return apply


def _friction(rover: Rover, size: float) -> float:
    return peak_ay(rover) / GRAVITY / size


def _load(form: int) -> Applied:
    def apply(rover: Rover, size: float, _extras: Extras) -> Rover:
        return rover.of(load_form=form, load_k=size)

    return apply


def _ratio(rover: Rover, size: float, _extras: Extras) -> Rover:
    """Softer in front: the other way a rover soon oversteers."""
    n = rover.numbers
    both, share = (n.Cf * n.Cr) ** 0.5, _front_over_rear(rover, size) ** 0.5
    return rover.of(Cf=both * share, Cr=both / share)


def _front_over_rear(_rover: Rover, size: float) -> float:
    return exp(-size)


def _relaxing(form: float) -> Applied:
    def apply(rover: Rover, size: float, _extras: Extras) -> Rover:
        return rover.of(sigma=share_of_base(rover, size), sigma_form=form)

    return apply


def _tyres() -> list[Law]:
    names = ("Fiala", "Magic Formula", "tanh", "Dugoff", "arctangent", "exponential")
    laws = [
        Law("tyre_saturation", name, "tyre", 0.3, 1.1, _tyre(k + 1), "-", _friction, own=name == "tanh")
        for k, name in enumerate(names)
    ]
    laws += [
        Law("load_transfer", "parabola", "tyre", 0.3, 4.0, _load(1), own=True),
        Law("load_transfer", "sin 2 atan", "tyre", 0.5, 3.0, _load(3)),
        Law("front_rear_stiffness", "ratio", "axles", 0.22, 0.5, _ratio, value=_front_over_rear, own=True),
        Law("tyre_relaxation", "both axles", "tyre", 0.2, 1.5, _relaxing(0.0), "m", share_of_base, own=True),
        Law("tyre_relaxation", "front axle", "tyre", 0.3, 2.0, _relaxing(2.0), "m", share_of_base),
    ]
    return laws


def _heading(rng: Generator) -> dict[str, float]:
    return {"heading": float(rng.uniform(-3.14, 3.14))}


def _slope(rover: Rover, size: float, extras: Extras) -> Rover:
    return rover.of(slope=size, slope_heading=extras["heading"])


def _wind(rover: Rover, size: float, extras: Extras) -> Rover:
    base, h = rover.numbers.a + rover.numbers.b, rover.numbers.h
    blown = rover.of(wind_x=extras["lever"] * base, wind_z=h)
    return blown.amid(wind=size, wind_heading=extras["heading"], gusts=extras["gusts"])


def _blowing(rng: Generator) -> dict[str, float]:
    return _heading(rng) | {"lever": float(rng.uniform(-0.1, 0.15)), "gusts": float(rng.choice([0.0, 0.2]))}


def _dry(form: int) -> Applied:
    def apply(rover: Rover, size: float, _extras: Extras) -> Rover:
        return rover.of(friction=_moment(rover, size), friction_form=form)

    return apply


def _moment(rover: Rover, size: float) -> float:
    return size * rover.numbers.ms * rover.numbers.h * peak_ay(rover)


def _damped(rover: Rover, size: float, _extras: Extras) -> Rover:
    return rover.of(yaw_c=_damping(rover, size))


def _locked(rover: Rover, size: float, _extras: Extras) -> Rover:
    return rover.of(diff_c=2 * size * turning_stiffness(rover) / rover.numbers.track**2)


def _damping(rover: Rover, size: float) -> float:
    return size * turning_stiffness(rover) / rover.speed


def _body() -> list[Law]:
    laws = [
        Law("suspension_friction", form, "roll", 0.05, 0.7, _dry(k), "N m", _moment, own=k == 0)
        for k, form in enumerate(("tanh", "Stribeck", "soft"))
    ]
    return [
        *laws,
        Law(
            "roll_steer",
            "front axle",
            "roll",
            0.15,
            1.0,
            lambda r, s, e: r.of(roll_steer_front=e["sign"] * s),
            "rad/rad",
            extras=a_sign,
            own=True,
        ),
        Law(
            "roll_steer",
            "rear axle",
            "roll",
            0.15,
            1.0,
            lambda r, s, e: r.of(roll_steer_rear=e["sign"] * s),
            "rad/rad",
            extras=a_sign,
        ),
        Law("yaw_damping", "moment", "yaw", 0.1, 1.2, _damped, "N m s/rad", _damping, own=True),
        Law("yaw_damping", "locked wheels", "yaw", 0.1, 1.2, _locked, "N m s/rad", _damping),
        Law("cross_slope", "plane", "ground", 0.025, 0.13, _slope, "rad", extras=_heading, own=True),
        Law("side_wind", "force by heading", "ground", 0.25, 1.5, _wind, "m/s^2", extras=_blowing, own=True),
    ]


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


def _surfaces() -> list[Law]:
    rows = (
        ("instant", _instant),
        ("ramp", _instant),
        ("later runs", _later),
        ("one run", _later),
        ("drift", None),
    )
    return [
        Law("surface_change", form, "ground", 0.12, 0.45, _surface(form), "-", _kept, own=form == "instant")
        if draw is None
        else Law(
            "surface_change", form, "ground", 0.12, 0.45, _surface(form), "-", _kept, draw, form == "instant"
        )
        for form, draw in rows
    ]


VEHICLE: tuple[Law, ...] = (*_tyres(), *_body(), *_surfaces())
