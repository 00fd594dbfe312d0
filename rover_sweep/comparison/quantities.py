"""The numbers, effects and instruments in which simulation and recordings can differ."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from math import exp

import numpy as np

from rover_sweep.comparison.answer import Kind
from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.effects import Effect
from rover_sweep.diagnosis.effects.kinds import DegreeOfFreedom, FilterEffect, NominalEffect, SensorEffect
from rover_sweep.diagnosis.search.material import material_sizes
from rover_sweep.diagnosis.simulation.candidates import Model
from rover_sweep.diagnosis.simulation.nominal import Coordinate

Values = Mapping[str, float]
Reported = dict[str, tuple[float, str, str]]  # {parameter: (value, unit, meaning)}
INSTRUMENT_EFFECTS = {"clock_offset", "velocity_lag", "imu_offset", "imu_tilt"}
SMALL = 0.03  # relative change of a number that does not matter


@dataclass(frozen=True, eq=False)
class Comparable:
    """One candidate for a difference.

    parts: per free direction, the coordinates that it moves, {coordinate: amount per unit}; a number has one
    direction, an effect one for each parameter. report: what a user reads at the coordinates of the whole
    model. matters: change of the first direction from which the difference counts. relative: the direction
    is the logarithm of the number.
    """

    name: str
    kind: Kind
    parts: tuple[Mapping[str, float], ...]
    report: Callable[[Values], Reported]
    matters: float
    relative: bool = False
    effect: Effect | None = None

    def columns(self, coordinates: tuple[Coordinate, ...]) -> Array:
        """The directions as columns (k, m), in coordinates over their scales."""
        out = np.zeros((len(coordinates), len(self.parts)))
        for j, part in enumerate(self.parts):
            for i, c in enumerate(coordinates):
                out[i, j] = part.get(c.name, 0.0) / c.scale
        return out


@dataclass(frozen=True)
class _Number:
    """A number of the model: what it moves, its value, and the change that matters."""

    name: str
    unit: str
    meaning: str
    moves: Mapping[str, float]
    of: Callable[[Values], float]
    matters: float = SMALL
    relative: bool = False
    kind: Kind = "number"


def _exp(*parts: tuple[str, float]) -> Callable[[Values], float]:
    return lambda x: exp(sum(factor * x.get(name, 0.0) for name, factor in parts))


def _own(name: str) -> Callable[[Values], float]:
    return lambda x: x.get(name, 0.0)


def _relative(name: str, unit: str, meaning: str, coordinate: str, matters: float) -> _Number:
    return _Number(name, unit, meaning, {coordinate: 1.0}, _exp((coordinate, 1.0)), matters, True)


def _axle(name: str, meaning: str, sign: float) -> _Number:
    """One axle's stiffness: Cf = C sqrt(ratio), Cr = C/sqrt(ratio); the other one stays."""
    value = _exp(("ln_C", 1.0), ("ln_ratio", 0.5 * sign))
    return _Number(name, "N/rad", meaning, {"ln_C": 0.5, "ln_ratio": sign}, value, 0.05, True)


def _absolute(name: str, unit: str, meaning: str, coordinate: str, matters: float, kind: Kind) -> _Number:
    return _Number(name, unit, meaning, {coordinate: 1.0}, _own(coordinate), matters, False, kind)


_NUMBERS: tuple[_Number, ...] = (
    _relative("C", "N/rad", "cornering stiffness of an axle, both axles", "ln_C", SMALL),
    _axle("Cf", "cornering stiffness, front axle", 1.0),
    _axle("Cr", "cornering stiffness, rear axle", -1.0),
    _relative("Izz", "kg m^2", "yaw inertia", "ln_Izz", 0.05),
    _relative("L_eff", "m", "effective wheelbase", "ln_L_eff", SMALL),
    _relative("k_phi", "N m/rad", "roll stiffness", "ln_k_phi", 0.05),
    _relative("b_phi", "N m s/rad", "roll damping", "ln_b_phi", 0.10),
    _absolute("servo_lag", "s", "first-order lag of the steering", "lag", 0.008, "number"),
    _absolute("servo_delay", "s", "delay of the steering", "delay", 0.006, "number"),
    _absolute("lag_shape", "", "second-order share of the servo's lag", "lag_shape", 0.5, "number"),
    _absolute("steering_trim", "rad", "road-wheel angle at the trim", "trim", 0.006, "number"),
    _absolute("tyre_bend", "", "curvature of the tyres' force near the limit", "bend", 0.7, "number"),
    _absolute("track", "m^2", "square of half the track", "track", 0.05, "number"),
    _absolute("imu_x", "m", "IMU further forward than in the vehicle file", "imu_x", 0.012, "instrument"),
    _absolute("imu_z", "m", "IMU further up than in the vehicle file", "imu_z", 0.012, "instrument"),
    _absolute("bias_ay", "m/s^2", "offset of the accelerometer", "bias_ay", 0.15, "instrument"),
    _absolute("ay_lag", "s", "a_y later than r", "ay_lag", 0.005, "instrument"),
    _absolute("p_lag", "s", "p later than r", "p_lag", 0.005, "instrument"),
    _absolute("velocity_lag", "s", "lag of the estimator's velocity", "vy_lag", 0.012, "instrument"),
    _absolute("heading", "rad", "error of the estimator's heading", "heading", 0.025, "instrument"),
    _absolute("vy_gain", "", "relative error of V_y", "vy_gain", 0.10, "instrument"),
    _absolute("speed_scale", "", "true speed over the logged one, minus 1", "vscale", 0.02, "instrument"),
)


def quantities(model: Model, coordinates: tuple[Coordinate, ...]) -> tuple[Comparable, ...]:
    """All quantities that move a coordinate of the model."""
    known = {c.name for c in coordinates}
    numbers = (_quantity(n) for n in (*_of_rover(model), *_NUMBERS) if n.moves.keys() <= known)
    return (*numbers, *_effects(model, known))


def _of_rover(model: Model) -> Iterator[_Number]:
    """Numbers of the vehicle file, with their nominal values."""
    rover = model.rover
    yield _Number(
        "rad_per_us",
        "of the vehicle file",
        "steering angle per PWM",
        {"scale": 1.0},
        lambda x: 1.0 + x.get("scale", 0.0),
        0.02,
        True,
    )
    yield _Number(
        "cg_to_front_axle",
        "m",
        "centre of mass to the front axle",
        {"da": 1.0},
        lambda x: rover.a + x.get("da", 0.0),
        0.008,
    )
    for name, size, unit, meaning in (
        ("h", rover.h, "m", "height of the sprung mass above the roll axis"),
        ("Ixx", rover.roll_inertia, "kg m^2", "roll inertia"),
    ):
        if size:
            value = size
            yield _Number(
                name,
                unit,
                meaning,
                {f"ln_{name}": 1.0},
                lambda x, n=name, v=value: v * exp(x.get(f"ln_{n}", 0.0)),  # type: ignore[misc]
                0.10,
                True,
            )


def _quantity(n: _Number) -> Comparable:
    def report(x: Values) -> Reported:
        return {n.name: (n.of(x), n.unit, n.meaning)}

    return Comparable(n.name, n.kind, (n.moves,), report, n.matters, n.relative)


def _effects(model: Model, known: set[str]) -> Iterator[Comparable]:
    for effect in (model.law(name) for name in model.effects):
        if isinstance(effect, NominalEffect):
            continue
        moved = _moved(effect, known)
        if moved:
            yield Comparable(
                effect.id,
                "instrument" if _of_instruments(effect) else "size",
                tuple({name: 1.0} for name in moved),
                effect.reported,
                _matters(effect, model),
                effect=effect,
            )


def _moved(effect: Effect, known: set[str]) -> list[str]:
    if isinstance(effect, DegreeOfFreedom):
        own = ("ln_C", "ln_Izz") if effect.id == "tyre_slip" else ("ln_k_phi", "ln_b_phi")
        return [name for name in own if name in known]
    return [n for p in effect.parameters if (n := effect.coordinate_name(p)) in known and not p.nominal]


def _of_instruments(effect: Effect) -> bool:
    return isinstance(effect, SensorEffect | FilterEffect) or effect.id in INSTRUMENT_EFFECTS


def _matters(effect: Effect, model: Model) -> float:
    sizes = material_sizes(effect, model.spread, model.rover.wheelbase)
    first = effect.parameters[0]
    return sizes.get(first.name, 0.0)
