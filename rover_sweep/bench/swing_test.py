"""Moment of inertia from the swing test of the paper, section 2.2, with its uncertainty.

The rover hangs on two parallel vertical wires of length h, a distance d apart, on either side of its
centre of gravity (bifilar pendulum). Swung to and fro in the plane of the wires it moves without turning,
a simple pendulum of length h: equation (1) must give g. Turned about the vertical and let go it swings
with a period T that gives its moment of inertia about the vertical axis through the CG: equation (2).
Uncertainties are propagated to first order.
"""

from __future__ import annotations

import math
import statistics
from dataclasses import dataclass, field
from typing import Literal

from rover_sweep.data.vehicle_file import Measured

Axis = Literal["yaw", "roll"]
GRAVITY = Measured(9.81, 0.02)  # m/s^2; 9.78 at the equator, 9.83 at the poles
AXES: dict[Axis, str] = {
    "yaw": "whole vehicle about the vertical axis through its CG (z)",
    "roll": "sprung mass about the forward axis through its own CG (x)",
}
KEY: dict[Axis, str] = {"yaw": "vehicle.yaw_inertia", "roll": "vehicle.roll_inertia"}

MOST_PERCENT = 3.0  # how far equation (1) may be off g
MOST_SIGMAS = 3.0


@dataclass(frozen=True)
class Swings:
    """Times [s] that `count` full swings took, each time measured anew; timer_sd [s] of one timing."""

    times: tuple[float, ...]
    count: int = 1
    timer_sd: float = 0.2

    def __post_init__(self) -> None:
        if not self.times or min(self.times) <= 0 or self.count < 1:
            raise ValueError(f"need times > 0 and a count >= 1, got {self.times} and {self.count}")

    @property
    def period(self) -> Measured:
        """Mean period [s]; sd of the mean from the spread of the times, but not less than the timer's own."""
        spread = statistics.stdev(self.times) if len(self.times) > 1 else 0.0
        sd = max(spread, self.timer_sd) / math.sqrt(len(self.times))
        return Measured(statistics.fmean(self.times) / self.count, sd / self.count)


@dataclass(frozen=True)
class GravityCheck:
    """Equation (1): g [m/s^2] of the simple pendulum, and how far it is from the known one."""

    gravity: Measured

    @property
    def percent(self) -> float:
        """Deviation from GRAVITY, %."""
        return 100 * (self.gravity.value / GRAVITY.value - 1)

    @property
    def sigmas(self) -> float:
        """Deviation in standard deviations of the two together."""
        sd = math.hypot(self.gravity.sd or 0.0, GRAVITY.sd or 0.0)
        return abs(self.gravity.value - GRAVITY.value) / sd

    @property
    def passed(self) -> bool:
        """Within 3 % and within 3 sd."""
        return abs(self.percent) <= MOST_PERCENT and self.sigmas <= MOST_SIGMAS


@dataclass(frozen=True)
class SwingTest:
    """The measurements: mass hung [kg], wire length h and spacing d [m], period of the turning swing [s].

    rig_mass, rig_period: of the board or cradle swung alone on the same wires, if there was one; `period` is
    then that of rover and rig together and `mass` that of the rover alone.
    """

    mass: Measured
    length: Measured
    spacing: Measured
    period: Measured
    rig_mass: Measured | None = None
    rig_period: Measured | None = None

    def __post_init__(self) -> None:
        if (self.rig_mass is None) != (self.rig_period is None):
            raise ValueError("rig_mass and rig_period go together")


@dataclass(frozen=True)
class Inertia:
    """The result: moment [kg m^2]; shares: share of the variance due to each measurement, 0..1."""

    moment: Measured
    radius_of_gyration: float
    shares: dict[str, float] = field(default_factory=dict)


def gravity_check(length: Measured, period: Measured) -> GravityCheck:
    """g = 4 pi^2 h / T^2, equation (1); length h [m], period T [s] of the swing without turning."""
    gravity = 4 * math.pi**2 * length.value / period.value**2
    relative = math.hypot((length.sd or 0.0) / length.value, 2 * (period.sd or 0.0) / period.value)
    return GravityCheck(Measured(gravity, gravity * relative))


def moment_of_inertia(test: SwingTest) -> Inertia:
    """I = m g d^2 T^2 / (16 pi^2 h), equation (2), less the rig's; sd to first order.

    Rover and rig hang on the same wires, so their errors in g, d and h are common:
    I = g d^2 / (16 pi^2 h) [(m + m_rig) T^2 - m_rig T_rig^2].
    """
    m, h, d, t, g = (x.value for x in (test.mass, test.length, test.spacing, test.period, GRAVITY))
    m_rig = test.rig_mass.value if test.rig_mass else 0.0
    t_rig = test.rig_period.value if test.rig_period else 0.0
    k = g * d**2 / (16 * math.pi**2 * h)
    moment = k * ((m + m_rig) * t**2 - m_rig * t_rig**2)
    slopes: list[tuple[str, Measured | None, float]] = [
        ("mass", test.mass, k * t**2),
        ("wire length", test.length, -moment / h),
        ("wire spacing", test.spacing, 2 * moment / d),
        ("period", test.period, 2 * k * (m + m_rig) * t),
        ("gravity", GRAVITY, moment / g),
        ("rig mass", test.rig_mass, k * (t**2 - t_rig**2)),
        ("rig period", test.rig_period, -2 * k * m_rig * t_rig),
    ]
    variances = {name: (slope * (x.sd or 0.0)) ** 2 for name, x, slope in slopes if x is not None}
    total = sum(variances.values())
    return Inertia(
        Measured(moment, math.sqrt(total)),
        math.sqrt(moment / m) if moment > 0 else 0.0,
        {name: variance / total for name, variance in variances.items()},
    )


def rounded(number: Measured) -> Measured:
    """The number to the second digit of its standard deviation."""
    if not number.sd:
        return number
    digits = 1 - math.floor(math.log10(number.sd))
    return Measured(round(number.value, digits), round(number.sd, digits))


def remarks(
    test: SwingTest, result: Inertia, check: GravityCheck | None, swing: Measured | None
) -> list[str]:
    """Warnings and advice on this test. swing: period of the check swing, to and fro."""
    said = []
    if check is None:
        said.append(
            "g was not checked: swing it to and fro in the plane of the wires, without turning, "
            "and give --check-times"
        )
    elif not check.passed:
        said.append(
            f"g comes out {check.percent:+.1f} % ({check.sigmas:.1f} sd) off {GRAVITY.value:g} m/s^2: "
            "measure the wires from clamp to clamp, count the swings again (there and back is one), and "
            "swing in the plane of the wires"
        )
    if swing is not None and abs(test.period.value / swing.value - 1) < 0.05:
        said.append(
            "the periods of turning and of swinging to and fro are nearly equal, so one motion excites the "
            f"other: choose a wire spacing clearly different from {test.spacing.value:g} m"
        )
    if exact := [name for name, x in _inputs(test) if x.sd is None]:
        said.append(f"no uncertainty was given for {', '.join(exact)}: counted as exact")
    if result.shares and (worst := max(result.shares, key=lambda name: result.shares[name])) != "gravity":
        said.append(
            f"to be more exact, measure the {worst} better: it brings {100 * result.shares[worst]:.0f} % "
            "of the variance"
        )
    return said


def _inputs(test: SwingTest) -> list[tuple[str, Measured]]:
    named = [("mass", test.mass), ("wire length", test.length), ("wire spacing", test.spacing)]
    return named + ([("rig mass", test.rig_mass)] if test.rig_mass else [])


CAVEATS = (
    "swings below 10 deg: 20 deg lengthens a period by 0.8 %, and the inertia comes out 1.5 % high",
    "air turns with the body and adds to its inertia, more for a big flat body shell; drag only damps: "
    "a third of the angle lost in ten swings is too much",
    "the CG midway between the wires, and the axis that is asked for vertical",
)
