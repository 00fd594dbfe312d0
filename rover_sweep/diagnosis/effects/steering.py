"""Effects between the commanded and the true angle of the front wheels: servo and linkage.

In the equations u is the angle before a part and d the one behind it [rad], left positive. Angles at rest or
in a gap are road-wheel angles. In the functions, q holds the parameters by name.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.effects.effect import EffectParameter as P
from rover_sweep.diagnosis.effects.effect import (
    NominalEffect,
    ServoEffect,
    SteeringEffect,
    Values,
    VehicleEffect,
    family,
)

BANDS, SPREAD = 16, 0.12  # bands whose mean is a law that jumps, and how far they lie about the one


@njit(cache=True, nogil=True)
def play(u: Array, half_gap: float) -> Array:
    """The play operator: the output (n,) stays until the input u (n,) rad has crossed the gap."""
    d = np.empty(u.size)
    x = u[0]
    for k in range(u.size):
        if u[k] - half_gap > x:
            x = u[k] - half_gap
        elif u[k] + half_gap < x:
            x = u[k] + half_gap
        d[k] = x
    return d


@njit(cache=True, nogil=True)
def hysteresis(u: Array, half_gap: float) -> Array:
    """u - b z (n,), z the Bouc-Wen variable with n = 1, exact between the samples of u (n,) rad."""
    d = np.empty(u.size)
    z, before = 0.0, u[0]
    for k in range(u.size):
        du = u[k] - before
        if du != 0.0:
            side = 1.0 if du > 0 else -1.0
            z = side - (side - z) * np.exp(-abs(du) / half_gap)
        before = u[k]
        d[k] = u[k] - half_gap * z
    return d


@njit(cache=True, nogil=True)
def jumps(u: Array, band: float) -> Array:
    """Angle (n,): held until the command u (n,) is more than the band away, then set to u.

    Mean over bands near this one: the instant of a jump depends on the last digits of u, the mean does not.
    """
    d = np.zeros(u.size)
    for part in range(BANDS):
        here, x = band * (1.0 + SPREAD * ((2 * part + 1) / BANDS - 1.0)), u[0]
        for k in range(u.size):
            if abs(u[k] - x) > here:
                x = u[k]
            d[k] += x
    return d / BANDS


@njit(cache=True, nogil=True)
def sticks(u: Array, band: float) -> Array:
    """Angle (n,): held until u (n,) is more than the band away, then follows u until u reverses.

    Mean over bands near this one, as in `jumps`.
    """
    d = np.zeros(u.size)
    for part in range(BANDS):
        here = band * (1.0 + SPREAD * ((2 * part + 1) / BANDS - 1.0))
        x, way, before = u[0], 0.0, u[0]
        for k in range(u.size):
            du = u[k] - before
            before = u[k]
            if way != 0.0 and du * way < 0.0:
                way = 0.0
            if way == 0.0 and abs(u[k] - x) > here:
                way = 1.0 if u[k] > x else -1.0
            if way != 0.0:
                x = u[k]
            d[k] += x
    return d / BANDS


def full_outside(u: Array, q: Values) -> Array:
    """0 within w, u outside, with a transition of a tenth of w; u (n,) rad."""
    if q["w"] <= 0:
        return u
    return np.asarray(u * np.clip((np.abs(u) - q["w"]) / (0.1 * q["w"]) + 0.5, 0.0, 1.0))


LAWS = (
    # Adds constants to r and a_y in the ratio V; straight driving shows it best.
    NominalEffect(
        id="steering_trim",
        title="steering is not centred",
        equation="d = u - u0",
        source="definition of a trim",
        parameters=(
            P(
                "u0",
                "rad",
                0.03,
                -0.3,
                0.3,
                "angle subtracted from the commanded one, left positive",
                matters=0.01,
                nominal="trim",
            ),
        ),
        apart="a tilted IMU changes a_y alone, at standstill too; a slope changes with the heading",
        next_run="drive straight without steering and measure the drift",
        releases={"trim": (-0.3, 0.3)},
    ),
    # A number to measure, no physics of the rover: measure it first where it is a finding.
    NominalEffect(
        id="steering_scale",
        title="wrong steering scale (rad_per_us)",
        equation="d = (1 + s) u",
        source="definition of a scale",
        parameters=(
            P(
                "s",
                "-",
                0.1,
                -0.6,
                1.0,
                "relative error of rad_per_us, positive where the wheels turn farther",
                matters=0.08,
                nominal="scale",
            ),
        ),
        apart="changes r and a_y alike at all frequencies and amplitudes",
        next_run="measure the angle of a wheel at three pulse widths with the rover on blocks (bench)",
        baselines=("roll-yaw", "bicycle", "kinematic"),
        releases={"scale": (-0.6, 1.0)},
    ),
    # Causes a third harmonic at every frequency; the residual power grows 23 times when the amplitude
    # doubles, so it needs two amplitudes. The factor is at least 0.1, so that d never turns back.
    *family(
        SteeringEffect(
            id="steering_nonlinearity",
            title="steering gain that changes with the angle",
            equation="d = u (1 + c3 u^2)",
            source="first odd term of the series of any symmetric linkage",
            parameters=(
                P("c3", "1/rad^2", 3.0, -25.0, 25.0, "cubic term of the steering gain", tolerance=0.3),
            ),
            apart="does not depend on frequency, a rate limit does; tyre saturation depends on a_y",
            next_run="rover on blocks: angle of the wheel at five commands from lock to lock",
            act=lambda u, q: u * np.maximum(1.0 + q["c3"] * u * u, 0.1),
            form="cubic",
        ),
        {
            "form": "quadratic",
            "equation": "d = u (1 + c3 a abs(u)), a = 0.3 rad",
            "source": "gain that changes from the centre on",
            "act": lambda u, q: u * np.maximum(1.0 + q["c3"] * 0.3 * np.abs(u), 0.1),
        },
    ),
    # Causes a second harmonic only, and a mean; one sweep of any amplitude is enough. Both forms have the
    # same gains at 0.3 rad.
    *family(
        SteeringEffect(
            before_servo=True,
            id="steering_asymmetry",
            title="steering gain differs left and right",
            equation="d = (1 + e) u for u > 0 (left), (1 - e) u for u < 0",
            source="piecewise linear gain of the linkage",
            parameters=(
                P(
                    "e",
                    "-",
                    0.1,
                    -0.6,
                    0.6,
                    "half the difference of the gains left and right over their mean",
                    tolerance=0.01,
                ),
            ),
            apart="second harmonic only; the mean that a trim causes does not change with the amplitude",
            next_run="turning circles to the left and to the right at the same command",
            act=lambda u, q: u + q["e"] * np.abs(u),
            form="two slopes",
        ),
        {
            "form": "quadratic",
            "equation": "d = u + e u^2/a, a = 0.3 rad",
            "source": "first even term of the series of any linkage",
            "act": lambda u, q: u + q["e"] * u * u / 0.3,
        },
    ),
    # Causes a third harmonic at low frequency and no phase lag; a small amplitude shows it best.
    *family(
        SteeringEffect(
            before_servo=True,
            id="steering_deadband",
            title="deadband of the steering",
            equation="e -> 0 for abs(e) < w, else e - w sgn(e)",
            source="Tao and Kokotovic 1996, dead zone",
            parameters=(
                P("w", "rad", 0.01, 0.0, 0.15, "half width of the band, road-wheel angle", tolerance=0.001),
            ),
            apart="adds no phase lag, a backlash does; its share grows as the amplitude falls",
            next_run="rover on blocks: a slow ramp up and down, angle of the wheel over command",
            act=lambda u, q: u - np.clip(u, -q["w"], q["w"]),
            signed=False,
            form="subtracted",
        ),
        {
            "form": "full travel",
            "equation": "u -> 0 for abs(u) < w, else u",
            "source": "Tao and Kokotovic 1996, dead zone with a jump",
            "act": full_outside,
        },
    ),
    # Many digital servos have such a band against hunting. It causes steps at small amplitude, and a lag of
    # half of s on average.
    *family(
        SteeringEffect(
            before_servo=True,
            id="steering_stiction",
            title="steering that sticks",
            equation="the servo's target d stays until abs(u - d) > s, then d = u",
            source="Armstrong-Helouvry 1994, stiction; position band of a digital servo",
            parameters=(
                P("s", "rad", 0.012, 0.0, 0.15, "largest error at rest, road-wheel angle", tolerance=0.0015),
            ),
            apart="reaches the command once it moves; with a backlash or a deadband, it does not",
            next_run="rover on blocks: a slow ramp, angle of the wheel over command",
            act=lambda u, q: jumps(u, q["s"]) if q["s"] > 0 else u,
            signed=False,
            form="no memory",
        ),
        {
            "form": "with memory",
            "equation": "d stays until abs(u - d) > s, then follows u until u turns back",
            "act": lambda u, q: sticks(u, q["s"]) if q["s"] > 0 else u,
        },
    ),
    # Causes a third harmonic and a phase lag at all frequencies; the residual power grows only 1.6 times when
    # the amplitude doubles. Reversals at small amplitude show it best.
    *family(
        SteeringEffect(
            id="steering_backlash",
            title="backlash of the linkage",
            equation="play operator of half gap b",
            source="Tao and Kokotovic 1996, backlash",
            parameters=(
                P("b", "rad", 0.01, 0.0, 0.15, "half of the gap, road-wheel angle", tolerance=0.0015),
            ),
            apart="the wheel lags by the gap at every reversal, as with a servo that stops short; "
            "with a deadband it does not",
            next_run="rover on blocks: a slow ramp up and down, angle of the wheel over command",
            act=lambda u, q: play(u, q["b"]),
            signed=False,
            form="play",
        ),
        {
            "form": "smooth hysteresis",
            "equation": "d = u - b z, b z' = u' - abs(u') z",
            "source": "Wen 1976, with n = 1",
            "act": lambda u, q: hysteresis(u, q["b"]) if q["b"] > 0 else u,
        },
    ),
    # Of column, linkage and servo, with the tyres' trail. Linear tyres only lose front stiffness by it, C/(1
    # + k C), so tyres that saturate, or a known ratio of both axles, are needed to separate it from
    # front_rear_stiffness.
    VehicleEffect(
        id="steering_compliance",
        title="compliance of the steering",
        equation="d - k F_front",
        source="Milliken and Milliken 1995, compliance steer",
        parameters=(
            P(
                "kC",
                "-",
                0.3,
                0.0,
                4.0,
                "angle lost over slip angle, k times the front stiffness",
                tolerance=0.05,
                matters=0.15,
            ),
        ),
        apart="grows with the side force; an uneven stiffness is the same for linear tyres",
        next_run="rover on blocks: turn a front wheel by hand with a spring balance, servo powered",
        fills={"kC": "compliance"},
        baselines=("roll-yaw", "bicycle"),
        signed=False,
    ),
    # Up to 40 ms, or 70 ms together with the transport delay, are a normal tolerance of the baseline. q of
    # the second form is `lag_shape` of the nominal model.
    *family(
        NominalEffect(
            id="servo_lag",
            title="slow steering servo",
            equation="T d' = u - d",
            source="first-order lag; a finding above 40 ms alone or 70 ms with the delay",
            parameters=(
                P("T", "s", 0.06, 0.0, 0.5, "time constant of the whole first-order lag", nominal="lag"),
            ),
            apart="a delay changes the phase but not the gain; a rate limit grows with the amplitude",
            next_run="rover on blocks: a step of 100 us, angle of the wheel over time",
            releases={"lag": (0.0, 0.5)},
            form="first order",
        ),
        {
            "form": "second order",
            "title": "swinging steering servo",
            "equation": "q T^2 d'' + T d' + d = u",
            "source": "second-order servo, damping ratio 1/(2 sqrt(q))",
            "releases": {"lag": (0.0, 0.5), "lag_shape": (0.0, 8.0)},
        },
    ),
    # Servos are sold with 0.10 to 0.20 s per 60 deg, 5 to 10 rad/s; slower than 4 rad/s matters. The residual
    # power grows about 17 times when the amplitude doubles: two amplitudes, the large one at high frequency.
    ServoEffect(
        id="servo_rate_limit",
        title="rate limit of the servo",
        equation="abs(d') <= R",
        source="slew-rate limit of RC servos",
        parameters=(
            P(
                "R",
                "rad/s",
                0.4,
                0.0,
                3.0,
                "fastest rate of the road wheel's angle",
                form="inverse",
                tolerance=0.03,
                matters=0.25,
            ),
        ),
        apart="grows with amplitude and frequency; a lag does not, a cubic gain does not depend on frequency",
        next_run="a second sweep at half the amplitude, or a large step with the rover on blocks",
        fills={"R": "inv_rate"},
        signed=False,
    ),
    # Up to 40 ms, or 70 ms together with the servo lag, are a normal tolerance of the baseline.
    NominalEffect(
        id="transport_delay",
        title="transport delay of the steering",
        equation="d(t) = u(t - T)",
        source="pure delay; a finding above 40 ms alone or 70 ms with the servo lag",
        parameters=(P("T", "s", 0.06, 0.0, 0.5, "the whole pure delay", nominal="delay"),),
        apart="a servo lag lowers the gain as well as the phase",
        next_run="rover on blocks: a step of 100 us, time until the wheel moves",
        releases={"delay": (0.0, 0.5)},
    ),
)
