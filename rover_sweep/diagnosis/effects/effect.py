"""The contract of every left-out effect: its texts, its parameters, and when it is a finding.

An effect is a family of laws, its forms, which share its id. The subclasses of `Effect` say where it acts in
the simulation, and how.

A parameter has a physical value and a coordinate, which the fit moves; the coordinate 0 means absent. They
are equal except for two forms: `inverse` (a rate limit, a cut-off) has the coordinate 1/value, and `ratio`
has the coordinate ln(value).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from math import exp, inf, log
from typing import Any, Literal

from rover_sweep.data.recording import Array

Values = Mapping[str, float]
Reported = dict[str, tuple[float, str, str]]  # {name: (value, unit, convention)}, for a user


@dataclass(frozen=True)
class EffectParameter:
    """A parameter of an effect. All numbers but `per` are coordinates.

    size: plainly visible on a rover of 2 to 3 kg; used for the first look and as the scale of the fit.
    low, high: bounds. convention: meaning and sign of the value, for a user.
    tolerance: standard deviation over normal rovers.
    matters: an effect below this size is within normal tolerance; None: twice the tolerance.
    doubt: standard deviation that no data of this kind can reduce.
    nominal: name of this parameter in the nominal model; "" if the effect adds its own coordinate.
    per: nominal coordinate per unit of the value.
    grows_with: quantity of the rover that scales the numbers; they hold for 0.5 m or 3 N m.
    """

    name: str
    unit: str
    size: float
    low: float
    high: float
    convention: str
    form: Literal["plain", "inverse", "ratio"] = "plain"
    tolerance: float = 0.0
    matters: float | None = None
    doubt: float = 0.0
    nominal: str = ""
    per: float = 1.0
    grows_with: Literal["", "wheelbase", "roll moment"] = ""

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

    def times(self, factor: float) -> EffectParameter:
        """The parameter with all its coordinates times a factor."""
        scaled = {n: factor * getattr(self, n) for n in ("size", "low", "high", "tolerance", "doubt")}
        matters = None if self.matters is None else factor * self.matters
        return replace(self, matters=matters, **scaled)


@dataclass(frozen=True, kw_only=True)
class Effect:
    """One law of a left-out effect.

    id: name in files and on the command line. title, equation: for reports, in the field's symbols, SI
    units, ISO axes. source: a reference. apart: how it differs from
    similar effects. next_run: what to drive or measure to confirm it.
    baselines: models that can lack it. channels: at least one of these must be recorded.
    signed: both signs of the parameters are possible.
    releases: {nominal coordinate: (low, high)} that the effect frees beyond the normal tolerance.
    report_values: ({parameter: value}) -> values for a user, if they differ from the fitted ones.
    form: name of this law in its family, "" if it is the only one. first: it is the first one.
    in_one_run: it happens in one run at an instant, the parameter `t`.
    """

    id: str
    title: str
    equation: str
    source: str
    parameters: tuple[EffectParameter, ...]
    apart: str
    next_run: str
    baselines: tuple[str, ...] = ("roll-yaw", "bicycle", "lumped", "kinematic")
    channels: tuple[str, ...] = ("r", "ay", "p", "vy")
    signed: bool = True
    releases: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    report_values: Callable[[Values], Reported] | None = None
    form: str = ""
    first: bool = True
    in_one_run: bool = False

    @property
    def name(self) -> str:
        """The id, or "<id>/<form>" of a further form."""
        return self.id if self.first else f"{self.id}/{self.form}"

    def sized(self, growth: Mapping[str, float]) -> Effect:
        """This law with the sizes of a larger rover. growth: {`grows_with`: factor}."""
        sized = tuple(p.times(growth.get(p.grows_with, 1.0)) for p in self.parameters)
        return self if sized == self.parameters else replace(self, parameters=sized)

    def key(self, parameter: str) -> str:
        """Name of an added coordinate in the whole model: "<id>.<parameter>"."""
        return f"{self.id}.{parameter}"

    def coordinate_name(self, parameter: EffectParameter) -> str:
        """Name of the parameter's coordinate in the whole model, a nominal or an added one."""
        return parameter.nominal or self.key(parameter.name)

    def coordinates(self, x: Values) -> dict[str, float]:
        """{parameter: added coordinate} from the coordinates x of the whole model, 0 where absent."""
        return {p.name: x.get(self.key(p.name), 0.0) for p in self.parameters}

    def values(self, x: Values) -> dict[str, float]:
        """{parameter: physical value} from the coordinates x of the whole model."""
        return {p.name: p.value(x.get(self.coordinate_name(p), 0.0) / p.per) for p in self.parameters}

    def reported(self, x: Values) -> Reported:
        """Values for a user: {name: (value, unit, convention)}."""
        found = self.values(x)
        if self.report_values:
            return self.report_values(found)
        return {p.name: (found[p.name], p.unit, p.convention) for p in self.parameters}

    @property
    def thresholds(self) -> dict[str, float]:
        """{parameter: coordinate from which the effect is a finding}, of the parameters that have one."""
        sizes = {p.name: 2.0 * p.tolerance if p.matters is None else p.matters for p in self.parameters}
        return {name: size for name, size in sizes.items() if size > 0}

    def exceeds(self, x: Values, thresholds: Mapping[str, float]) -> bool:
        """True if any parameter reaches its threshold, or none has a threshold."""
        found = self.values(x)
        size = {p.name: abs(p.coordinate(found[p.name])) for p in self.parameters}
        return not thresholds or any(size[name] >= least for name, least in thresholds.items())


def family(first: Effect, *forms: Mapping[str, Any]) -> tuple[Effect, ...]:
    """The first law of an effect and its other forms, given as {field: value} that differ from the first.

    "kind": class of a form that acts elsewhere; it shares the texts, baselines and channels of the first.
    """
    texts = ("id", "title", "apart", "next_run", "baselines", "channels", "signed")
    out = [first]
    for form in forms:
        changes: dict[str, Any] = {**form, "first": False}
        kind = changes.pop("kind", None)
        shared = {name: getattr(first, name) for name in texts}
        out.append(kind(**shared | changes) if kind else replace(first, **changes))
    return tuple(out)


# The kinds of effect, by the place in the simulation where they act.
#
# In the functions, q is {parameter: added coordinate}, and a motion is {name: (n,)} as
# `simulation.simulator.motion` gives it, SI units, ISO axes.


Motion = Mapping[str, Array]
Force = tuple[Any, Any, Any]  # side force [N], yaw moment, roll moment [N m]; each (n,) or 0.0


class NominalEffect(Effect):
    """Frees coordinates of the nominal model; adds no term."""


class DegreeOfFreedom(Effect):
    """Adds sideslip or roll, which the baseline does not have; `Model.slip` and `Model.roll` follow it."""


@dataclass(frozen=True, kw_only=True)
class SteeringEffect(Effect):
    """Changes the angle behind the servo, or the commanded one before it.

    act: (angle (n,) rad, q) -> angle (n,) rad.
    """

    act: Callable[[Array, Values], Array]
    before_servo: bool = False


@dataclass(frozen=True, kw_only=True)
class KernelEffect(Effect):
    """Acts inside a compiled loop of `simulation.simulator`.

    fills: {parameter: argument of the loop}. sets: {argument: constant} that selects the form.
    """

    fills: Mapping[str, str]
    sets: Mapping[str, float] = field(default_factory=dict)

    def numbers(self, x: Values) -> dict[str, float]:
        """{argument of the loop: value} at coordinates x of the whole model."""
        found = self.coordinates(x).items()
        return {**self.sets, **{self.fills[name]: value for name, value in found if name in self.fills}}


class ServoEffect(KernelEffect):
    """Fills arguments of `simulator.servo`."""


class VehicleEffect(KernelEffect):
    """A term of the equations of motion; fills fields of `single_track.VehicleNumbers`."""


@dataclass(frozen=True, kw_only=True)
class ForceEffect(Effect):
    """Adds forces to the body. act: (motion before it is simulated, q, mass [kg]) -> side force, yaw moment,
    roll moment.

    weight: the side force is a part of the weight, which an accelerometer does not measure.
    """

    act: Callable[[Motion, Values, float], Force]
    weight: bool = False


@dataclass(frozen=True, kw_only=True)
class StateForceEffect(Effect):
    """Adds forces that depend on the simulated motion.

    law: (q) -> law. push: side force, yaw and roll moment per unit of it.
    """

    law: Callable[[Values], Any]
    push: tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class GripEffect(Effect):
    """Scales the stiffness of both axles. act: ({"t", "V", "driven"}, q) -> factor (n,).

    driven (n,): time driven until then in all runs [s]. later: (q) -> factor in the runs after the one in
    which it happens; None: 1.
    """

    act: Callable[[Motion, Values], Array]
    later: Callable[[Values], float] | None = None


@dataclass(frozen=True, kw_only=True)
class SensorEffect(Effect):
    """Changes what the sensors measure. act: ({channel: (n,)}, motion, q) -> {channel: (n,)}."""

    act: Callable[[Mapping[str, Array], Motion, Values], Mapping[str, Array]]


@dataclass(frozen=True, kw_only=True)
class FilterEffect(Effect):
    """A low-pass of channels. response: (w (k,) rad/s, q) -> {channel: complex frequency response (k,)}.

    heading: the estimator integrates the filtered yaw rate, so that its heading lags and turns V_y.
    """

    response: Callable[[Array, Values], Mapping[str, Any]]
    heading: bool = False


class SpeedEffect(Effect):
    """Acts on the speed alone, which is measured and drives the simulation; see `posterior.speed_loss`."""
