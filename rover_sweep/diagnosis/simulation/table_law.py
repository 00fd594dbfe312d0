"""A law without a name: a table y(x) over one quantity of the motion, acting at one place of the model.

Between its points the table is linear, beyond its ends constant. Axes ISO, SI units. The simulated rover
reads the same table from its variant file.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from rover_sweep.data.geometry import Geometry
from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.effects.effect import Effect, EffectParameter, Values
from rover_sweep.diagnosis.effects.kinds import ForceEffect, LinkageEffect, SensorEffect
from rover_sweep.diagnosis.effects.steering import play
from rover_sweep.diagnosis.simulation.experiment import RATE
from rover_sweep.diagnosis.simulation.structure import Structure

SMOOTH = 0.02  # s, first-order lag before a derivative of the steering angle
PASSES = 5  # of the simulation with a force that depends on the motion that it causes
UNITS = {"steering": "rad", "yaw moment": "N m", "roll moment": "N m"}  # of y; forces are in N
SENSORS = {"r": "rad/s", "ay": "m/s^2", "p": "rad/s", "vy": "m/s"}
FORCES = ("side force front", "side force rear", "side force", "yaw moment", "roll moment")
PLACES = ("steering", *FORCES, *(f"sensor of {c}" for c in SENSORS))
OVER: Mapping[str, str] = {
    "delta": "rad",
    "delta_dot": "rad/s",
    "a_y": "m/s^2",
    "r": "rad/s",
    "p": "rad/s",
    "phi": "rad",
    "beta": "rad",
    "v": "m/s",
    "psi": "rad",
    "t": "s",
    "r_dot": "rad/s^2",
    "p_dot": "rad/s^2",
    "v_dot": "m/s^2",
    "signal": "",
    "signal_dot": "",
}
MEMORIES = ("", "lag", "play")
LARGEST = 1e6  # largest accepted number of a table
FACTORS = ("delta", "a_y", "r", "v^2")  # a table may be multiplied by one of them


@dataclass(frozen=True)
class TableLaw:
    """y over x at a place.

    place: "steering" (angle of the front wheels), "side force front", "side force rear", "side force",
    "yaw moment", "roll moment", or "sensor of r" (ay, p, vy). over: a key of `OVER`. x (k,) ascending, y
    (k,). times: "" or a member of `FACTORS`, by which y is multiplied. memory: "" for none; "lag": x is the
    part of the quantity that is newer than `size` [s], q - q lagged in first order; "play": x is the quantity
    behind a play of half width `size`.
    """

    place: str
    over: str
    x: tuple[float, ...]
    y: tuple[float, ...]
    times: str = ""
    memory: str = ""
    size: float = 0.0

    @property
    def unit(self) -> str:
        """Unit of y."""
        own = SENSORS.get(self.place.removeprefix("sensor of "), UNITS.get(self.place, "N"))
        per = {"delta": "rad", "a_y": "(m/s^2)", "r": "(rad/s)", "v^2": "(m/s)^2"}.get(self.times)
        return f"{own}/{per}" if per else own

    @property
    def over_unit(self) -> str:
        """Unit of x."""
        signal = SENSORS.get(self.place.removeprefix("sensor of "), "")
        return {"signal": signal, "signal_dot": f"{signal}/s"}.get(self.over, OVER[self.over])

    def at(self, x: Array) -> Array:
        """The table at x (n,)."""
        return np.interp(x, self.x, self.y)


def refuse_law(law: TableLaw) -> None:
    """ValueError for a table that cannot be simulated, from a damaged or foreign file."""
    if law.place not in PLACES:
        raise ValueError(f"there is no place {law.place!r}")
    if law.over not in OVER or law.times not in ("", *FACTORS) or law.memory not in MEMORIES:
        raise ValueError(
            f"a law over {law.over!r} times {law.times!r} with memory {law.memory!r} is not known"
        )
    numbers = np.array([*law.x, *law.y, law.size], float)
    if len(law.x) != len(law.y) or len(law.x) < 2 or not np.all(np.abs(numbers) < LARGEST):
        raise ValueError("the table of a law needs as many x as y, at least two, all of them finite")
    if not np.all(np.diff(law.x) > 0) or (law.memory and not law.size > 0.0):
        raise ValueError("the x of a law must increase, and its memory must be above 0")
    if law.place == "steering" and (law.over not in ("delta", "delta_dot") or law.times):
        raise ValueError("a law in the steering depends on the steering angle only")
    if law.over.startswith("signal") and not law.place.startswith("sensor"):
        raise ValueError("a law over a sensor's signal acts on that sensor only")


def quantity(over: str, m: Mapping[str, Array], signal: Array | None = None) -> Array:
    """The quantity (n,) in a motion as `simulator.motion` gives it; signal (n,): of the sensor's channel."""
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
    """x (n,) with a memory, see `TableLaw`."""
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


def rate(x: Array) -> Array:
    """The derivative (n,) of x (n,), smoothed."""
    return np.gradient(lagged(x, SMOOTH), 1 / RATE)


def factor(times: str, m: Mapping[str, Array]) -> Array | float:
    """The factor (n,) of a table."""
    if times == "v^2":
        return np.square(m["V"])
    return {"a_y": m["across"], "delta": m["delta"], "r": m["r"]}[times] if times else 1.0


def acting(law: TableLaw, m: Mapping[str, Array], signal: Array | None = None) -> Array:
    """What the law adds (n,) in a motion, in `law.unit` times the unit of the factor."""
    x = remembered(quantity(law.over, m, signal), law.memory, law.size)
    return law.at(x) * factor(law.times, m)


def law_effect(law: TableLaw, rover: Geometry, name: str = "law") -> Effect:
    """The effect that simulates the law. Its coordinates name.y0, name.y1, ... are added to the table."""
    known = tuple(f"y{k}" for k in range(len(law.y)))

    def at(q: Values) -> TableLaw:
        y = tuple(v + q.get(k, 0.0) for k, v in zip(known, law.y, strict=True))
        return replace(law, y=y)

    if law.place == "steering":
        act: Callable[..., Any] = partial(_steer, at)
        return LinkageEffect(**_common(law, name), act=act)
    if law.place.startswith("sensor of "):
        return SensorEffect(**_common(law, name), act=partial(_sense, at, law.place.split()[-1]))
    act = partial(_push, at, force_at(law.place, rover))
    return ForceEffect(**_common(law, name), act=act, iterate=True, passes=PASSES)


def force_at(place: str, rover: Geometry) -> tuple[float, float, float]:
    """Side force, yaw moment [m] and roll moment by a unit force, or unit moment, at a place."""
    return {
        "side force front": (1.0, rover.a, 0.0),
        "side force rear": (1.0, -rover.b, 0.0),
        "side force": (1.0, 0.0, 0.0),
        "yaw moment": (0.0, 1.0, 0.0),
        "roll moment": (0.0, 0.0, 1.0),
    }[place]


def with_laws(structure: Structure, laws: Sequence[TableLaw]) -> Structure:
    """The structure with laws; the coordinates of the k-th, law<k>.y0 and on, are added to its table."""
    effects = tuple(law_effect(law, structure.rover, f"law{k + 1}") for k, law in enumerate(laws))
    return replace(structure, effects=(*structure.effects, *effects)) if laws else structure


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


def _push(
    at: Callable[[Values], TableLaw],
    push: tuple[float, float, float],
    m: Mapping[str, Array],
    q: Values,
    mass: float,
) -> tuple[Any, Any, Any]:
    force = acting(at(q), m)
    return push[0] * force, push[1] * force, push[2] * force


def _common(law: TableLaw, name: str) -> dict[str, Any]:
    size = max((abs(v) for v in law.y), default=0.0) or 1.0
    parameters = tuple(
        EffectParameter(f"y{k}", law.unit, size, -np.inf, np.inf, "added to the table")
        for k in range(len(law.y))
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
