"""A law without a name: a table y(x) over one quantity of the motion, acting at one place of the model.

Between its points the table is linear, beyond its ends constant. Axes ISO, SI units. The simulated rover
reads the same table from its variant file.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import exp
from typing import Any

import numpy as np

from rover_sweep.data.geometry import Geometry
from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.effects.effect import (
    Effect,
    EffectParameter,
    SensorEffect,
    StateForceEffect,
    SteeringEffect,
    Values,
)
from rover_sweep.diagnosis.effects.steering import play
from rover_sweep.diagnosis.simulation.candidates import Model
from rover_sweep.diagnosis.simulation.experiment import RATE
from rover_sweep.diagnosis.simulation.single_track import LAG, NO_LAW, RESONATOR, TABLE, LawNumbers

SMOOTH = 0.02  # s, first-order lag before a derivative of the steering angle
STATES = ("a_y", "r", "p", "phi", "beta")  # quantities that the simulation finds; the others are given
UNITS = {"steering": "rad", "yaw moment": "N m", "roll moment": "N m"}  # of y; forces are in N
SENSORS = {"r": "rad/s", "ay": "m/s^2", "p": "rad/s", "vy": "m/s"}
FORCES = ("side force front", "side force rear", "side force", "yaw moment", "roll moment")
PLACES = ("steering", *FORCES, *(f"sensor of {c}" for c in SENSORS))
OVER: Mapping[str, tuple[str, str]] = {  # quantity of which a law is a function: (unit, in words)
    "delta": ("rad", "the steering angle"),
    "delta_dot": ("rad/s", "the rate of the steering angle"),
    "a_y": ("m/s^2", "a_y"),
    "r": ("rad/s", "r"),
    "p": ("rad/s", "p"),
    "phi": ("rad", "the roll angle"),
    "beta": ("rad", "the sideslip angle"),
    "v": ("m/s", "the speed"),
    "psi": ("rad", "the heading"),
    "t": ("s", "the time in the run"),
    "r_dot": ("rad/s^2", "the yaw acceleration"),
    "p_dot": ("rad/s^2", "the roll acceleration"),
    "v_dot": ("m/s^2", "the longitudinal acceleration"),
    "signal": ("", "its own signal"),
    "signal_dot": ("", "the rate of its own signal"),
}
MEMORIES = ("", "lag", "play", "resonance")
FASTEST = 20.0  # Hz, of a resonator
LARGEST = 1e6  # largest accepted number of a table
FACTORS: Mapping[str, tuple[str, str]] = {  # a table may be multiplied by one of them: (unit, in words)
    "delta": ("rad", "steering angle"),
    "a_y": ("(m/s^2)", "a_y"),
    "r": ("(rad/s)", "r"),
    "v^2": ("(m/s)^2", "speed squared"),
}


@dataclass(frozen=True)
class TableLaw:
    """y over x at a place.

    place: "steering" (angle of the front wheels), "side force front", "side force rear", "side force",
    "yaw moment", "roll moment", or "sensor of r" (ay, p, vy). over: a key of `OVER`. x (k,) ascending, y
    (k,). times: "" or a member of `FACTORS`, by which y is multiplied. memory: "" for none; "lag": x is the
    part of the quantity that is newer than `size` [s], q - q lagged in first order; "play": x is the quantity
    behind a play of half width `size`; "resonance": the law is no table but y[0] u + y[1] u'/w, u the
    displacement of a resonator of `size` [Hz], w = 2 pi size, and the ratio `damping`, which the quantity
    drives.
    """

    place: str
    over: str
    x: tuple[float, ...]
    y: tuple[float, ...]
    times: str = ""
    memory: str = ""
    size: float = 0.0
    damping: float = 0.0

    @property
    def kind(self) -> tuple[str, ...]:
        """Equal for laws that differ only in numbers."""
        return self.place, self.over, self.times, self.memory

    @property
    def unit(self) -> str:
        """Unit of y."""
        own = SENSORS.get(self.place.removeprefix("sensor of "), UNITS.get(self.place, "N"))
        return f"{own}/{FACTORS[self.times][0]}" if self.times in FACTORS else own

    @property
    def over_unit(self) -> str:
        """Unit of x."""
        signal = SENSORS.get(self.place.removeprefix("sensor of "), "")
        return {"signal": signal, "signal_dot": f"{signal}/s"}.get(self.over, OVER[self.over][0])

    def at(self, x: Array) -> Array:
        """The table at x (n,)."""
        return np.interp(x, self.x, self.y)


def resonator(place: str, over: str, frequency: float, damping: float) -> TableLaw:
    """A law with a hidden resonator and y = 0."""
    return TableLaw(place, over, (0.0, 1.0), (0.0, 0.0), memory="resonance", size=frequency, damping=damping)


def refuse_law(law: TableLaw) -> None:
    """ValueError if a table from a damaged or foreign file cannot be simulated."""
    if law.place not in PLACES:
        raise ValueError(f"there is no place {law.place!r}")
    if law.over not in OVER or law.times not in ("", *FACTORS) or law.memory not in MEMORIES:
        raise ValueError(f"unknown law: over={law.over!r}, times={law.times!r}, memory={law.memory!r}")
    numbers = np.array([*law.x, *law.y, law.size, law.damping], float)
    if len(law.x) != len(law.y) or len(law.x) < 2 or not np.all(np.abs(numbers) < LARGEST):
        raise ValueError("the table of a law needs as many x as y, at least two, all of them finite")
    if not np.all(np.diff(law.x) > 0) or (law.memory and not law.size > 0.0):
        raise ValueError("the x of a law must increase, and its memory must be above 0")
    sound = law.size <= FASTEST and law.damping > 0.0 and len(law.y) == 2 and not law.times
    if law.memory == "resonance" and not sound:
        raise ValueError(
            f"a resonator needs a frequency up to {FASTEST:g} Hz, a damping above 0, 2 y values and no "
            f"`times`; got {law.size:g} Hz, {law.damping:g}, {len(law.y)} y values, times {law.times!r}"
        )
    if law.place == "steering" and (law.over not in ("delta", "delta_dot") or law.times):
        raise ValueError("a law in the steering depends on the steering angle only")
    if law.over.startswith("signal") and not law.place.startswith("sensor"):
        raise ValueError("a law over a sensor's signal acts on that sensor only")


def quantity(over: str, m: Mapping[str, Array], signal: Array | None = None) -> Array:
    """The quantity (n,) in a motion from `simulator.motion`; signal (n,): of the sensor's channel."""
    if over == "delta_dot":
        return rate(m["delta"])
    if over == "signal_dot":
        return np.gradient(_given(signal), 1 / RATE)
    if over == "signal":
        return _given(signal)
    if over == "psi":
        return np.asarray((m["psi"] + np.pi) % (2 * np.pi) - np.pi)
    if over == "beta":
        return m["v"] / m["V"]
    name = {"a_y": "across", "v": "V", "v_dot": "v_dot_x"}.get(over, over)
    return m[name]


def remembered(x: Array, memory: str, size: float) -> Array:
    """x (n,) with memory, see `TableLaw`."""
    if memory == "lag":
        return x - lagged(x, size)
    if memory == "play":
        return np.asarray(play(x, size))
    return x


def lagged(x: Array, lag: float) -> Array:
    """x (n,) through a first-order lag [s]."""
    from scipy.signal import lfilter  # loads half of scipy

    keep = float(np.exp(-1 / (RATE * lag)))
    return np.asarray(lfilter([1 - keep], [1, -keep], x, zi=[keep * x[0]])[0])


def resonating(x: Array, frequency: float, damping: float) -> tuple[Array, Array]:
    """(u (n,), u'/w (n,)) of a resonator u'' + 2 damping w u' + w^2 u = w^2 x that rests at x[0].

    By the bilinear transform, exact at the frequency [Hz] (Oppenheim and Schafer 2010, section 7.2).
    """
    from scipy.signal import lfilter  # loads half of scipy

    k = 1.0 / np.tan(np.pi * frequency / RATE)
    below = [k * k + 2 * damping * k + 1, 2 - 2 * k * k, k * k - 2 * damping * k + 1]
    rest = x - x[0]
    return np.asarray(x[0] + lfilter([1, 2, 1], below, rest)), np.asarray(lfilter([k, 0, -k], below, rest))


def rate(x: Array) -> Array:
    """The derivative (n,) of x (n,), smoothed."""
    return np.gradient(lagged(x, SMOOTH), 1 / RATE)


def factor(times: str, m: Mapping[str, Array]) -> Array | float:
    """The factor (n,) of a table."""
    if times == "v^2":
        return np.square(m["V"])
    return quantity(times, m) if times else 1.0


def acting(law: TableLaw, m: Mapping[str, Array], signal: Array | None = None) -> Array:
    """Output (n,) of the law in a motion, in `law.unit` times the factor's unit."""
    x = quantity(law.over, m, signal)
    if law.memory == "resonance":
        u, rate_over_w = resonating(x, law.size, law.damping)
        return law.y[0] * u + law.y[1] * rate_over_w
    return law.at(remembered(x, law.memory, law.size)) * factor(law.times, m)


def law_at(law: TableLaw, name: str, root: Array, x: Values) -> TableLaw:
    """The law at coordinates x of a model: its y plus name.z0, ... times the columns of root (k, m).

    For a resonator, name.size and name.damping change the logarithms of frequency and damping.
    """
    y = root @ [x.get(f"{name}.z{k}", 0.0) for k in range(root.shape[1])] + law.y
    if law.memory == "resonance":
        size, damping = (getattr(law, n) * exp(x.get(f"{name}.{n}", 0.0)) for n in ("size", "damping"))
        law = replace(law, size=size, damping=damping)
    return replace(law, y=tuple(y.tolist()))


def law_effect(law: TableLaw, rover: Geometry, name: str = "law", root: Array | None = None) -> Effect:
    """The effect that simulates the law, see `law_at`. root: the unit matrix by default."""
    root = np.eye(len(law.y)) if root is None else root
    names = tuple(f"z{k}" for k in range(root.shape[1]))

    def at(q: Values) -> TableLaw:
        return law_at(law, name, root, {f"{name}.{k}": v for k, v in q.items()})

    if law.place == "steering":
        act: Callable[..., Any] = partial(_steer, at)
        return SteeringEffect(**_common(law, name, names), act=act)
    if law.place.startswith("sensor of "):
        return SensorEffect(**_common(law, name, names), act=partial(_sense, at, law.place.split()[-1]))
    return StateForceEffect(**_common(law, name, names), law=at, push=force_at(law.place, rover))


def force_at(place: str, rover: Geometry) -> tuple[float, float, float]:
    """Side force, yaw moment [m] and roll moment by a unit force, or unit moment, at a place."""
    return {
        "side force front": (1.0, rover.a, 0.0),
        "side force rear": (1.0, -rover.b, 0.0),
        "side force": (1.0, 0.0, 0.0),
        "yaw moment": (0.0, 1.0, 0.0),
        "roll moment": (0.0, 0.0, 1.0),
    }[place]


def with_laws(model: Model, laws: Sequence[TableLaw]) -> Model:
    """The model with laws."""
    effects = tuple(law_effect(law, model.rover, f"law{k + 1}") for k, law in enumerate(laws))
    return replace(model, unnamed=(*model.unnamed, *effects)) if laws else model


def law_numbers(effects: Sequence[StateForceEffect], base: Mapping[str, Array], x: Values) -> LawNumbers:
    """The numbers of the compiled loop for laws on the body. base {name: (n,)}: the given motion."""
    laws = [e.law(e.coordinates(x)) for e in effects]
    inside = [law.over in STATES for law in laws]
    kinds = {"": TABLE, "lag": LAG, "resonance": RESONATOR}
    width = max(len(law.y) for law in laws)
    given = [
        np.full_like(base["t"], factor(law.times, base) if law.times not in STATES else 1.0)
        if state
        else acting(replace(law, times="" if law.times in STATES else law.times), base)
        for law, state in zip(laws, inside, strict=True)
    ]
    return LawNumbers(
        push=np.array([e.push for e in effects]),
        given=np.array(given),
        kind=np.array([kinds[law.memory] if s else NO_LAW for law, s in zip(laws, inside, strict=True)]),
        over=np.array([STATES.index(law.over) if law.over in STATES else -1 for law in laws]),
        times=np.array([STATES.index(law.times) if law.times in STATES else -1 for law in laws]),
        memory=np.array([(law.size, law.damping) for law in laws]),
        x=np.array([np.pad(law.x, (0, width - len(law.x)), mode="edge") for law in laws]),
        y=np.array([np.pad(law.y, (0, width - len(law.y)), mode="edge") for law in laws]),
    )


def _given(signal: Array | None) -> Array:
    if signal is None:
        raise ValueError("a law over a sensor's signal acts on that sensor only")
    return signal


def _steer(at: Callable[[Values], TableLaw], steer: Array, q: Values) -> Array:
    return steer + acting(at(q), {"delta": steer})


def _sense(
    at: Callable[[Values], TableLaw],
    channel: str,
    out: Mapping[str, Array],
    m: Mapping[str, Array],
    q: Values,
) -> Mapping[str, Array]:
    return {**out, channel: out[channel] + acting(at(q), m, out[channel])}


def _common(law: TableLaw, name: str, coordinates: Sequence[str]) -> dict[str, Any]:
    parameters = tuple(
        EffectParameter(k, "", 1.0, -np.inf, np.inf, "added to the law")
        for k in (*coordinates, *(("size", "damping") if law.memory == "resonance" else ()))
    )
    return {
        "id": name,
        "title": f"a law at the {law.place}",
        "equation": f"{law.place} = f({law.over})",
        "source": "model-error model",
        "parameters": parameters,
        "apart": "",
        "next_run": "",
    }
