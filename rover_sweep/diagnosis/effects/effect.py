"""The contract of every left-out effect: its texts, its parameters, and when it is a finding.

An effect is a family of laws, its forms, which share its id. The kinds of effect in `kinds` add where it acts
in the simulation, and how.

A parameter has a physical value and a coordinate, which the fit moves; the coordinate 0 means absent. They
are equal except for two forms: `inverse` (a rate limit, a cut-off) has the coordinate 1/value, and `ratio`
has the coordinate ln(value).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from math import exp, inf, log
from typing import Any, ClassVar, Literal

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
    nominal: the coordinate of the nominal model that is this parameter; "" if the effect adds its own.
    per: nominal coordinate per unit of the value.
    grows_with: what of the rover its unit makes it grow with; the numbers are for 0.5 m or 3 N m of it.
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
    """A left-out effect, one law of it.

    id: name in files and on the command line. title, equation: for reports, in the field's symbols, SI
    units, ISO axes. source: a reference. apart: how it differs from
    similar effects. next_run: what to drive or measure to confirm it.
    baselines: the models that can lack it. channels: at least one of these must be recorded.
    signed: both signs of the parameters are possible.
    releases: {nominal coordinate: (low, high)} that the effect frees beyond the normal tolerance.
    report_values: ({parameter: value}) -> what a user reads, where that differs from the fitted parameters.
    form: name of this law among those of the family, "" where there is only one. first: of the family.
    """

    in_one_run: ClassVar[bool] = False
    """True where it happens in one run at an instant, the parameter `t`."""

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

    @property
    def name(self) -> str:
        """The id, and for a further form "<id>/<form>"."""
        return self.id if self.first else f"{self.id}/{self.form}"

    def sized(self, growth: Mapping[str, float]) -> Effect:
        """This law with the sizes of a larger rover. growth: {what it grows with: factor}."""
        sized = tuple(p.times(growth.get(p.grows_with, 1.0)) for p in self.parameters)
        return self if sized == self.parameters else replace(self, parameters=sized)

    def key(self, parameter: str) -> str:
        """Name of an added coordinate in the whole model: "<id>.<parameter>"."""
        return f"{self.id}.{parameter}"

    def coordinate_name(self, parameter: EffectParameter) -> str:
        """Name of the parameter's coordinate in the whole model: a nominal one, or one that is added."""
        return parameter.nominal or self.key(parameter.name)

    def coordinates(self, x: Values) -> dict[str, float]:
        """{parameter: added coordinate} from the coordinates x of the whole model, 0 where absent."""
        return {p.name: x.get(self.key(p.name), 0.0) for p in self.parameters}

    def values(self, x: Values) -> dict[str, float]:
        """{parameter: physical value} from the coordinates x of the whole model."""
        return {p.name: p.value(x.get(self.coordinate_name(p), 0.0) / p.per) for p in self.parameters}

    def reported(self, x: Values) -> Reported:
        """What a user reads: {name: (value, unit, convention)}."""
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
        """True where any parameter reaches its threshold, or no parameter has one."""
        found = self.values(x)
        size = {p.name: abs(p.coordinate(found[p.name])) for p in self.parameters}
        return not thresholds or any(size[name] >= least for name, least in thresholds.items())


def family(first: Effect, *forms: Mapping[str, Any]) -> tuple[Effect, ...]:
    """The first law of an effect and its other forms, each {field: value} where it differs from the first.

    "kind": class of a form that acts elsewhere; it shares the texts, baselines and channels of the first.
    """
    texts = ("id", "title", "apart", "next_run", "baselines", "channels", "signed")
    out = [first]
    for form in forms:
        changes = {**form, "first": False}
        kind = changes.pop("kind", None)
        shared = {name: getattr(first, name) for name in texts}
        out.append(kind(**shared | changes) if kind else replace(first, **changes))
    return tuple(out)
