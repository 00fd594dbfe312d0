"""The kinds of effect, by the place in the simulation where they act.

In the functions, q is {parameter: added coordinate}, and a motion is {name: (n,)} as
`simulation.simulator.motion` gives it, SI units, ISO axes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.effects.effect import Effect, Values

Motion = Mapping[str, Array]
Force = tuple[Any, Any, Any]  # side force [N], yaw moment, roll moment [N m]; each (n,) or 0.0


class NominalEffect(Effect):
    """Frees coordinates that the nominal model has anyway, and adds no term."""


class DegreeOfFreedom(Effect):
    """Adds sideslip or roll, which the baseline does not have; `Model.slip` and `Model.roll` follow it."""


@dataclass(frozen=True, kw_only=True)
class SteeringEffect(Effect):
    """Changes the road-wheel angle. act: (angle (n,) rad, q) -> angle (n,) rad."""

    act: Callable[[Array, Values], Array]


class CommandEffect(SteeringEffect):
    """Acts on the commanded angle, before the servo."""


class LinkageEffect(SteeringEffect):
    """Acts on the angle behind the servo."""


@dataclass(frozen=True, kw_only=True)
class KernelEffect(Effect):
    """Acts inside a compiled loop of `simulation.kernel`.

    fills: {parameter: number of the loop}. sets: {number of the loop: constant} that selects the form.
    """

    fills: Mapping[str, str]
    sets: Mapping[str, float] = field(default_factory=dict)

    def numbers(self, x: Values) -> dict[str, float]:
        """{number of the loop: value} at the coordinates x of the whole model."""
        found = self.coordinates(x).items()
        return {**self.sets, **{self.fills[name]: value for name, value in found if name in self.fills}}


class ServoEffect(KernelEffect):
    """Fills arguments of `kernel.servo`."""


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
    """Adds forces that depend on the motion that they cause.

    law: (q) -> law. push: side force, yaw moment and roll moment for 1 of it.
    """

    law: Callable[[Values], Any]
    push: tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class GripEffect(Effect):
    """Scales the stiffness of both axles in one run. act: (t (n,) s, q) -> factor (n,).

    later: (q) -> factor in the runs driven after it; None: 1.
    """

    in_one_run: ClassVar[bool] = True

    act: Callable[[Array, Values], Array]
    later: Callable[[Values], float] | None = None


@dataclass(frozen=True, kw_only=True)
class DriftEffect(Effect):
    """Scales the stiffness of both axles in all runs. act: (driven time before (n,) s, q) -> factor (n,)."""

    act: Callable[[Array, Values], Array]


@dataclass(frozen=True, kw_only=True)
class SpeedGripEffect(Effect):
    """Scales the stiffness of both axles by the speed. act: (V (n,) m/s, q) -> factor (n,)."""

    act: Callable[[Array, Values], Array]


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
