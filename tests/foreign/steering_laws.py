"""Laws of the list between the command and the road wheel."""

from __future__ import annotations

from dataclasses import replace

from tests.foreign.law import Applied, Extras, Law, a_sign, peak_ay
from tests.foreign.rover import Rover


def _angle(rover: Rover, size: float) -> float:
    return size * rover.amplitude


def _by_amplitude(name: str, form: float) -> Applied:
    """For a law whose field is a share of the large amplitude."""

    def apply(rover: Rover, size: float, _extras: Extras) -> Rover:
        return rover.of(**{name: size * rover.amplitude, f"{name}_form": form})

    return apply


def _steering() -> list[Law]:
    found = []
    for name, form, own, effect in (
        ("deadband", "dead zone", True, "steering_deadband"),
        ("deadband", "jump at its edge", False, "steering_deadband"),
        ("deadband", "soft", False, "steering_deadband"),
        ("stiction", "held target", True, "steering_stiction"),
        ("stiction", "drives until arrived", False, "steering_stiction"),
        ("stiction", "drives above an error", False, "steering_stiction"),
        ("play", "play", True, "steering_backlash"),
        ("play", "play with spring", False, "steering_backlash"),
        ("play", "Bouc-Wen", False, "steering_backlash"),
        ("play", "Dahl", False, "steering_backlash"),
    ):
        number = sum(law.effect == effect for law in found)
        apply = _by_amplitude(name, float(number))
        found.append(Law(effect, form, "linkage", 0.03, 0.3, apply, "rad", _angle, own=own))
    return found


def _curve(form: float) -> Applied:
    def apply(rover: Rover, size: float, _extras: Extras) -> Rover:
        loss = size / rover.amplitude**2 if form != 2.0 else size / (0.3 * rover.amplitude)
        return rover.of(curve=loss, curve_form=form)

    return apply


def _cubic_value(rover: Rover, size: float) -> float:
    return size / rover.amplitude**2


def _asymmetry(form: float) -> Applied:
    def apply(rover: Rover, size: float, extras: Extras) -> Rover:
        e = size if form == 0.0 else size / (8.0 * rover.amplitude)
        return rover.of(asymmetry=extras["sign"] * e, asymmetry_form=form)

    return apply


def _compliance(form: float) -> Applied:
    def apply(rover: Rover, size: float, _extras: Extras) -> Rover:
        return rover.of(compliance=_per_newton(rover, size), compliance_form=form)

    return apply


def _per_newton(rover: Rover, size: float) -> float:
    """Angle per front side force: the share `size` of the large amplitude is lost at its side force."""
    n = rover.numbers
    return size * rover.amplitude / (n.m * peak_ay(rover) * n.b / (n.a + n.b))


def _shaped() -> list[Law]:
    laws = [
        Law(
            "steering_nonlinearity",
            form,
            "shape",
            0.06,
            high,
            _curve(float(k)),
            "1/rad^2",
            _cubic_value,
            own=k == 0,
        )
        for k, (form, high) in enumerate((("cubic", 0.6), ("crank", 0.25), ("exponent", 0.6), ("tanh", 0.6)))
    ]
    laws += [
        Law("steering_asymmetry", form, "shape", 0.05, 0.4, _asymmetry(float(k)), extras=a_sign, own=k == 0)
        for k, form in enumerate(("two gains", "quadratic"))
    ]
    laws += [
        Law(
            "steering_compliance",
            form,
            "compliance",
            0.08,
            0.6,
            _compliance(float(k)),
            "rad/N",
            _per_newton,
            own=k == 0,
        )
        for k, form in enumerate(("side force", "aligning moment"))
    ]
    laws.append(
        Law(
            "steering_trim",
            "constant",
            "trim",
            0.02,
            0.09,
            lambda r, s, e: r.of(trim=e["sign"] * s),
            "rad",
            extras=a_sign,
            own=True,
            absolute=True,
        )
    )
    return laws


def _second_order(rover: Rover, size: float, _extras: Extras) -> Rover:
    zeta = 0.6  # lag of 2 zeta/w in all
    return rover.of(gain=1 / size, motor_lag=size / (4 * zeta * zeta))


def _rate(form: float) -> Applied:
    def apply(rover: Rover, size: float, _extras: Extras) -> Rover:
        return rover.of(rate=_slowest(rover, size), rate_form=form)

    return apply


def _slowest(rover: Rover, size: float) -> float:
    return 25.0 * rover.amplitude / size


def _late(rover: Rover, size: float, _extras: Extras) -> Rover:
    return replace(rover, delay=size)


def _framed(rover: Rover, size: float, _extras: Extras) -> Rover:
    frame = 0.04
    return replace(rover, delay=size - frame / 2).amid(hold=frame)


def _servo() -> list[Law]:
    def first(rover: Rover, size: float, _extras: Extras) -> Rover:
        return rover.of(gain=1 / size)

    return [
        Law("servo_lag", "first order", "servo", 0.09, 0.17, first, "s", own=True, absolute=True),
        Law("servo_lag", "second order", "servo", 0.09, 0.14, _second_order, "s", absolute=True),
        Law("transport_delay", "delay", "servo", 0.09, 0.15, _late, "s", own=True, absolute=True),
        Law("transport_delay", "delay and frame", "servo", 0.09, 0.15, _framed, "s", absolute=True),
        Law("servo_rate_limit", "limit", "servo", 1.05, 4.0, _rate(0.0), "rad/s", _slowest, own=True),
        Law("servo_rate_limit", "weak motor", "servo", 1.05, 4.0, _rate(1.0), "rad/s", _slowest),
    ]


STEERING: tuple[Law, ...] = (*_steering(), *_shaped(), *_servo())
