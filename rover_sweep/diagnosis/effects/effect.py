"""What every left-out effect is: an equation, its parameters, and where it acts in the simulation.

A value and its coordinate: the fit moves coordinates, whose absent value is 0. For most parameters they
are the same; `inverse` ones (a rate limit, a friction, a cut-off) have the coordinate 1/value, and a
`ratio` the coordinate ln(value).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from math import exp, inf, log
from typing import Any, Literal

from rover_sweep.data.recording import Array

Stage = Literal["command", "servo", "linkage", "vehicle", "force", "grip", "sensor", "filter", "speed"]
Values = Mapping[str, float]


@dataclass(frozen=True)
class EffectParameter:
    """A parameter of an effect.

    size: coordinate at which the effect is plain to see on a small rover, used for the first look and as
    the scale of the fit. low, high: bounds of the coordinate. convention: what the number means.
    tiny: standard deviation of the coordinate in an ordinary rover that nobody would call faulty.
    """

    name: str
    unit: str
    size: float
    low: float
    high: float
    convention: str
    tiny: float = 0.0
    form: Literal["plain", "inverse", "ratio"] = "plain"

    def value(self, coordinate: float) -> float:
        """The physical value at a coordinate."""
        if self.form == "inverse":
            return 1.0 / coordinate if coordinate > 0 else inf
        return exp(coordinate) if self.form == "ratio" else coordinate

    def coordinate(self, value: float) -> float:
        """The coordinate of a physical value."""
        if self.form == "inverse":
            return 0.0 if value == inf else 1.0 / value
        return log(value) if self.form == "ratio" else value


@dataclass(frozen=True)
class Effect:
    """A left-out effect; every module of this package that has an `EFFECT` is in the library.

    id: of the vocabulary. equation, source: in the field's symbols, and from where. shows: where it is seen.
    apart: what tells it from its neighbours; needs: which experiment shows it; next_run: what to drive to
    settle it. excites: what brings it out, in words.
    stage: where it acts. `act`, by stage:
      command, linkage: (steer (n,) rad, q) -> steer (n,), before and after the servo
      servo: no function; the coordinates fill the servo's slots (lag, delay, inv_rate)
      sensor: ({channel: (n,)}, motion {name: (n,)}, q) -> {channel: (n,)}
      filter: (w (k,) rad/s, q) -> {channel: frequency response (k,)}
      force: (motion {name: (n,)}, q, mass kg) -> (Fy, Mz, Mx), each (n,) N, N m, N m or 0.0
      grip: (t (n,), q) -> (n,) factor of both axles' stiffness
      speed: (speed (n,), motion, q) -> speed (n,) as the effect predicts it
      vehicle: no function; the coordinates fill slots of the compiled kernel
    slots: {parameter: slot}. iterate: a force that depends on the motion it makes;
    weight: a force that an accelerometer does not feel. shown: ({parameter: value}) -> {name: (value,
    unit, convention)} where the parameters that a user reads are others than the fitted ones. doubt: standard
    deviation of a parameter's coordinate that no data of this kind can take away.
    reads: {parameter: nominal coordinate that it is read off}; per: coordinates of one unit of its value.
    q: {parameter: coordinate}. releases: coordinates of the nominal model that the effect sets free beyond
    the material size, {name: (low, high)}. material: what a number of this effect must exceed to be more
    than a nuisance, {parameter: coordinate}. baselines: the models it can be missing from. channels: at
    least one of these must have been recorded. speeds: how many it takes. signed: either sign has a meaning.
    """

    id: str
    title: str
    equation: str
    source: str
    parameters: tuple[EffectParameter, ...]
    stage: Stage
    shows: str
    apart: str
    needs: str
    excites: str
    next_run: str
    act: Callable[..., Any] | None = None
    slots: Mapping[str, str] = field(default_factory=dict)
    reads: Mapping[str, str] = field(default_factory=dict)
    per: Mapping[str, float] = field(default_factory=dict)
    releases: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    material: Mapping[str, float] = field(default_factory=dict)
    baselines: tuple[str, ...] = ("roll-yaw", "bicycle", "lumped", "kinematic")
    channels: tuple[str, ...] = ("r", "ay", "p", "vy")
    speeds: int = 1
    signed: bool = True
    iterate: bool = False
    weight: bool = False
    shown: Callable[[Values], dict[str, tuple[float, str, str]]] | None = None
    doubt: Mapping[str, float] = field(default_factory=dict)

    def key(self, parameter: str) -> str:
        """Name of a coordinate in the whole model: "<id>.<parameter>"."""
        return f"{self.id}.{parameter}"

    @property
    def adds(self) -> tuple[str, ...]:
        """The parameters with a coordinate of their own; the others are read off a released one."""
        return tuple(p.name for p in self.parameters if p.name not in self.reads)

    def values(self, x: Values) -> dict[str, float]:
        """{parameter: physical value} out of the whole model's coordinates."""
        return {
            p.name: p.value(x.get(self.reads.get(p.name, self.key(p.name)), 0.0) / self.per.get(p.name, 1.0))
            for p in self.parameters
        }

    def reported(self, x: Values) -> dict[str, tuple[float, str, str]]:
        """What a user reads: {name: (value, unit, convention)}."""
        found = self.values(x)
        if self.shown:
            return self.shown(found)
        return {p.name: (found[p.name], p.unit, p.convention) for p in self.parameters}

    def counts(self, x: Values) -> bool:
        """True where any parameter reaches its material size, twice the tiny one where none is stated."""
        found = self.values(x)
        sizes = {p.name: self.material.get(p.name, 2.0 * p.tiny) for p in self.parameters}
        sizes = {name: size for name, size in sizes.items() if size > 0}
        coordinates = {p.name: abs(p.coordinate(found[p.name])) for p in self.parameters}
        return not sizes or any(coordinates[name] >= size for name, size in sizes.items())

    def coordinates(self, values: Values) -> dict[str, float]:
        """{parameter: coordinate} out of the whole model's values, 0 where absent."""
        return {p.name: values.get(self.key(p.name), 0.0) for p in self.parameters}


Motion = Mapping[str, Array]
