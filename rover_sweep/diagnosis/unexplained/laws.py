"""Unnamed terms: simple functions of the state that act on the steering, the body or a sensor.

A model error model (Ljung 1999) driven by the state. Each law adds one amount of one function
of the motion at one place of the simulation, so its signature passes the rover's own dynamics, as that of a
missing force does.

Ljung 1999: Model validation and model error modeling, Linkoping University, report LiTH-ISY-R-2125.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.effects.effect import Effect, EffectParameter
from rover_sweep.diagnosis.effects.kinds import ForceEffect, LinkageEffect, SensorEffect
from rover_sweep.diagnosis.simulation.experiment import RATE

Function = Callable[[Mapping[str, Array]], Array]
AMOUNT = 1e-3  # SI units, factor on a function of signals over their `SIZES`
SIZES = {"delta": 0.1, "r": 1.0, "across": 2.0, "v": 0.1, "p": 0.2, "phi": 0.02}  # SI, of a small rover
TURNOVER = 0.1  # of a signal's size, within which sgn changes smoothly from -1 to 1
CHANNELS = ("r", "ay", "p", "vy")


@dataclass(frozen=True, eq=False)
class Law:
    """One term. place: "steering", "yaw moment", ...; on: function of the state; effect: to simulate it."""

    place: str
    on: str
    effect: Effect

    @property
    def term(self) -> str:
        """The term as text, "place ~ function"."""
        return f"{self.place} ~ {self.on}"


def laws() -> tuple[Law, ...]:
    """All terms, about sixty."""
    force = partial(ForceEffect, iterate=True)
    return (
        *(_law("steering", on, LinkageEffect, _of_steering(f)) for on, f in _STEERING.items()),
        *(_law("side force", on, force, _of_force(0, f)) for on, f in _SIDE.items()),
        *(_law("yaw moment", on, force, _of_force(1, f)) for on, f in _YAW.items()),
        *(_law("roll moment", on, force, _of_force(2, f)) for on, f in _ROLL.items()),
        *(
            _law(f"sensor of {c}", on, SensorEffect, _of_sensor(c, f))
            for c in CHANNELS
            for on, f in {**_SENSOR, **_CROSSED.get(c, {})}.items()
        ),
    )


def _law(place: str, on: str, kind: Callable[..., Effect], act: Callable[..., Any]) -> Law:
    amount = EffectParameter("amount", "-", AMOUNT, -np.inf, np.inf, "of the function, SI")
    return Law(
        place,
        on,
        kind(
            id=f"{place} {on}",
            title=on,
            equation=on,
            source="model-error model",
            parameters=(amount,),
            apart="",
            next_run="",
            act=act,
        ),
    )


def _of_steering(f: Callable[[Array], Array]) -> Callable[..., Array]:
    return lambda steer, q: steer + q["amount"] * f(steer / SIZES["delta"])


def _of_force(k: int, f: Function) -> Callable[..., tuple[Any, ...]]:
    return lambda m, q, mass: tuple(q["amount"] * f(m) if j == k else 0.0 for j in range(3))


def _of_sensor(channel: str, f: Callable[[Array, Mapping[str, Array]], Array]) -> Callable[..., Any]:
    def act(out: Mapping[str, Array], m: Mapping[str, Array], q: Mapping[str, float]) -> Mapping[str, Array]:
        return {**out, channel: out[channel] + q["amount"] * f(out[channel], m)}

    return act


def _late(x: Array, memory: float) -> Array:
    """First-order low-pass from rest, by convolution: scipy.signal takes longer to load."""
    size = next_fast_len(2 * x.size, real=True)
    decay = np.exp(-np.arange(x.size) / (RATE * memory))
    return irfft(rfft(x, size) * rfft(decay * (1 - decay[1]), size), size)[: x.size]


def _rate(x: Array) -> Array:
    return np.gradient(_late(x, 0.02), 1 / RATE)


def _sign(x: Array) -> Array:
    return np.tanh(x / TURNOVER)


def _of(name: str, f: Callable[[Array], Array]) -> Function:
    return lambda m: f(m[name] / SIZES[name])


def _cube(x: Array) -> Array:
    return x**3


_STEERING: Mapping[str, Callable[[Array], Array]] = {
    "1": np.ones_like,
    "delta^3": _cube,
    "abs(delta)": np.abs,
    "sgn(delta)": _sign,
    "sgn(d delta/dt)": lambda d: _sign(_rate(d) / 10.0),
    "delta of the last 0.3 s": lambda d: _late(d, 0.3),
}
_COMMON: Mapping[str, Function] = {
    "a_y^3": _of("across", _cube),
    "abs(a_y)": _of("across", np.abs),
    "a_y of the last 0.15 s": _of("across", lambda x: _late(x, 0.15)),
    "r t": lambda m: m["r"] * (m["t"] - np.mean(m["t"])),
    "sin(psi)": lambda m: np.sin(m["psi"]),
    "cos(psi)": lambda m: np.cos(m["psi"]),
    "phi": lambda m: m["phi"],
}
_SIDE: Mapping[str, Function] = {**_COMMON, "v^3": _of("v", _cube), "sgn(v)": _of("v", _sign)}
_YAW: Mapping[str, Function] = {
    **_COMMON,
    "r^3": _of("r", _cube),
    "abs(r)": _of("r", np.abs),
    "sgn(r)": _of("r", _sign),
    "r of the last 0.15 s": _of("r", lambda x: _late(x, 0.15)),
}
_ROLL: Mapping[str, Function] = {
    "1": _of("phi", np.ones_like),
    "sgn(p)": _of("p", _sign),
    "p^3": _of("p", _cube),
    "phi^3": _of("phi", _cube),
    "abs(a_y)": _of("across", np.abs),
}
_SENSOR: Mapping[str, Callable[[Array, Mapping[str, Array]], Array]] = {
    "its size": lambda y, m: np.abs(y),
    "its rate": lambda y, m: np.gradient(y, 1 / RATE),
}
_CROSSED: Mapping[str, Mapping[str, Callable[[Array, Mapping[str, Array]], Array]]] = {
    "r": {"1": lambda y, m: np.ones_like(y), "p": lambda y, m: m["p"]},
    "p": {"r": lambda y, m: m["r"], "a_y": lambda y, m: m["across"]},
    "ay": {
        "1": lambda y, m: np.ones_like(y),
        "V'": lambda y, m: m["v_dot_x"],
        "r'": lambda y, m: m["r_dot"],
        "p'": lambda y, m: m["p_dot"],
    },
    "vy": {"r": lambda y, m: m["r"]},
}
