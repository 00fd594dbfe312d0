"""Effects of tyres and body: slip, roll, and the moments between them; then those of the ground and the wind.

In the equations alpha is the slip angle of an axle [rad], F its side force [N], C its cornering stiffness
[N/rad] (Cf front, Cr rear), d the road-wheel angle, phi and p roll angle and rate, r the yaw rate.
"""

from __future__ import annotations

import numpy as np

from rover_sweep.data.geometry import GRAVITY
from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.effects.effect import (
    DegreeOfFreedom,
    Force,
    ForceEffect,
    GripEffect,
    Motion,
    NominalEffect,
    Reported,
    SpeedEffect,
    Values,
    VehicleEffect,
    family,
)
from rover_sweep.diagnosis.effects.effect import EffectParameter as P

LAWS = (
    # Start and bounds are those of the bicycle model. r lags and V_y is not zero, more so with speed.
    DegreeOfFreedom(
        id="tyre_slip",
        title="tyres that slip sideways, and yaw inertia",
        equation="F = -C alpha, Izz r' = a Ff - b Fr",
        source="bicycle model, equation (17) of the paper",
        parameters=(
            P(
                "C",
                "N/rad",
                0.1,
                -9,
                9,
                "cornering stiffness of an axle, mean of both",
                form="ratio",
                nominal="ln_C",
            ),
            P("Izz", "kg m^2", 0.1, -9, 9, "yaw inertia about the CG", form="ratio", nominal="ln_Izz"),
        ),
        apart="a servo has the same lag at every speed; with slip the lag and the steady gain change with V",
        next_run="the same sweep at a second speed",
        baselines=("kinematic",),
    ),
    # A ratio within 15 % of 1 is a normal tolerance. At one speed C, Izz and the steering gain absorb it.
    NominalEffect(
        id="front_rear_stiffness",
        title="front and rear axle differ",
        equation="Cf != Cr, by more than 15 %",
        source="Gillespie 1992, chapter 6, understeer gradient",
        parameters=(
            P(
                "ratio",
                "-",
                0.35,
                -1.6,
                1.6,
                "Cf/Cr at fixed geometric mean",
                form="ratio",
                matters=0.15,
                nominal="ln_ratio",
            ),
        ),
        apart="the steady gain changes with the speed (understeer gradient)",
        next_run="steady circles at two speeds",
        releases={"ln_ratio": (-1.6, 1.6)},
        baselines=("roll-yaw", "bicycle"),
    ),
    # Fz: static load of the axle; z = C alpha/(mu Fz). A peak of 0.7 of the load and more (1/mu up to 1.4) is
    # a normal tyre, the bend of the nominal model, which is the beginning of the same law and held at 0. The
    # residual power grows 16 times when the amplitude doubles, so it needs two amplitudes.
    *family(
        VehicleEffect(
            id="tyre_saturation",
            title="saturation of the tyres",
            equation="F = mu Fz tanh(C alpha/(mu Fz))",
            source="Pacejka 2012, with tanh in place of the magic formula",
            parameters=(
                P(
                    "mu",
                    "-",
                    2.0,
                    0.0,
                    6.0,
                    "peak side force over the static axle load",
                    form="inverse",
                    matters=1.4,
                ),
            ),
            apart="depends on the side force; load transfer depends on a_y squared, "
            "a cubic gain on the angle",
            next_run="a sweep of double amplitude, and one at a second speed",
            fills={"mu": "inv_mu"},
            baselines=("roll-yaw", "bicycle"),
            releases={"bend": (0.0, 0.0)},
            signed=False,
            form="tanh",
        ),
        {
            "form": "brush",
            "equation": "F = mu Fz (z - z^2/3 + z^3/27), z = C alpha/(mu Fz) up to 3",
            "source": "Pacejka 2012, chapter 3, brush model",
            "sets": {"tyre_form": 1.0},
        },
        {
            "form": "falling peak",
            "equation": "F = mu Fz sin(1.6 atan(C alpha/(1.6 mu Fz)))",
            "source": "Pacejka 2012, chapter 4, magic formula with the shape factor 1.6",
            "sets": {"tyre_form": 2.0},
        },
        {
            "form": "knee",
            "equation": "F = C alpha/(1 + (C alpha/(mu Fz))^6)^(1/6)",
            "source": "a linear tyre up to Coulomb's limit, as a rigid wheel on dry ground",
            "sets": {"tyre_form": 3.0},
        },
    ),
    # F0: steady side force. The lag is proportional to 1/V and adds to the yaw damping, so it needs two
    # speeds.
    VehicleEffect(
        id="tyre_relaxation",
        title="relaxation length of the tyres",
        equation="(sigma/V) F' + F = F0",
        source="Pacejka 2012, chapter 5",
        parameters=(
            P(
                "sigma",
                "m",
                0.15,
                0.0,
                1.5,
                "relaxation length of both axles",
                tolerance=0.01,
                grows_with="wheelbase",
            ),
        ),
        apart="the lag of a servo or a delay does not change with the speed",
        next_run="the same sweep at half the speed",
        fills={"sigma": "sigma"},
        baselines=("roll-yaw", "bicycle"),
        signed=False,
    ),
    # As where friction goes with the speed of sliding and not with the slip angle. V0 is 1 m/s.
    GripEffect(
        id="tyre_speed",
        title="stiffness of the tyres that changes with the speed",
        equation="C (V/V0)^-k, V0 = 1 m/s",
        source="viscous friction at the contact: F goes with the sliding speed V alpha, so that k = -1",
        parameters=(P("k", "-", 0.3, -1.5, 1.5, "exponent of 1/V, both axles", tolerance=0.03),),
        apart="a change of ground happens at one time; this happens again at each speed",
        next_run="the same sweep at half the speed, then the first sweep again",
        act=lambda m, q: m["V"] ** -q["k"],
        baselines=("roll-yaw", "bicycle"),
    ),
    # The factor is at least 0.05. Needs a large a_y.
    VehicleEffect(
        id="load_transfer",
        title="lateral load transfer of the tyres",
        equation="C (1 - k (a_y/g)^2)",
        source="Milliken and Milliken 1995",
        parameters=(
            P("k", "-", 0.6, 0.0, 6.0, "loss of stiffness of both axles at a_y = g", tolerance=0.08),
        ),
        apart="similar to tyre saturation, but depends on a_y alone and not on the slip angle",
        next_run="steady circles at rising speed: side force against slip angle",
        fills={"k": "k_load"},
        baselines=("roll-yaw", "bicycle"),
        signed=False,
    ),
    # Start and bounds are those of the roll-yaw model. Shows in a_y, V_y' and p, never in r alone, best about
    # the roll mode, 15 to 30 rad/s of a small rover.
    DegreeOfFreedom(
        id="roll_dof",
        title="the body rolls",
        equation="(Ixx + ms h^2) p' + b_phi p + (k_phi - ms g h) phi = ms h (V_y' + V r)",
        source="roll-yaw model, equation (18) of the paper",
        parameters=(
            P("k_phi", "N m/rad", 0.1, -9, 9, "roll stiffness", form="ratio", nominal="ln_k_phi"),
            P("b_phi", "N m s/rad", 0.1, -9, 9, "roll damping", form="ratio", nominal="ln_b_phi"),
        ),
        apart="a wrong IMU position changes a_y alone",
        next_run="a sweep across the roll mode with p recorded",
        baselines=("kinematic", "bicycle"),
        channels=("ay", "p"),
    ),
    # Needs two speeds; the roll mode shows it best.
    *family(
        VehicleEffect(
            id="roll_steer",
            title="roll steer of the front axle",
            equation="d + e phi",
            source="Milliken and Milliken 1995",
            parameters=(P("e", "-", 0.3, -3.0, 3.0, "steering angle per roll angle", tolerance=0.02),),
            apart="changes the steady gain with the speed, as understeer does, but follows the roll mode",
            next_run="a sweep at a second speed across the roll mode",
            fills={"e": "e_roll"},
            baselines=("roll-yaw",),
            form="front axle",
        ),
        {
            "form": "rear axle",
            "title": "roll steer of the rear axle",
            "equation": "rear steering angle = e phi",
            "fills": {"e": "e_rear"},
        },
    ),
    # tanh(p/w), w = 0.01 rad/s exp(width), in place of the sign; the width is a number of the simulation and
    # not of the rover. Inflates b_phi; its share falls with the amplitude, so it needs p at two amplitudes.
    VehicleEffect(
        id="suspension_friction",
        title="dry friction of the suspension",
        equation="T sgn p against the roll",
        source="Coulomb friction; Armstrong-Helouvry, Dupont and Canudas de Wit 1994",
        parameters=(
            P(
                "T",
                "N m",
                0.03,
                0.0,
                4.0,
                "friction torque against the roll rate",
                tolerance=0.002,
                grows_with="roll moment",
            ),
            P("width", "-", 0.7, -3.0, 3.0, "ln of the roll rate of the smoothing over 0.01 rad/s"),
        ),
        apart="its share falls as the amplitude grows; the share of a damper does not",
        next_run="a sweep at half the amplitude across the roll mode",
        fills={"T": "T_roll", "width": "ln_width"},
        report_values=lambda found: {"T": (found["T"], "N m", "friction torque against the roll rate")},
        baselines=("roll-yaw",),
        channels=("p",),
        signed=False,
    ),
    # A locked axle drives both wheels at one speed, so that their longitudinal slip makes a moment
    # proportional to r/V; scrubbing tyres add more. At one speed stiffness and steering gain absorb most of
    # it.
    *family(
        VehicleEffect(
            id="yaw_damping",
            title="a yaw moment against the turn",
            equation="M = -c r",
            source="Milliken and Milliken 1995, locked axle",
            parameters=(
                P(
                    "c",
                    "1/s",
                    3.0,
                    0.0,
                    60.0,
                    "moment per yaw rate, over the yaw inertia of the vehicle file (m a b without one)",
                    tolerance=0.3,
                    matters=1.0,
                ),
            ),
            apart="damps the yaw rate at all speeds; an uneven stiffness acts through the slip angles",
            next_run="the same sweep with the differential open, or at a second speed",
            fills={"c": "yaw_damp"},
            baselines=("roll-yaw", "bicycle"),
            signed=False,
            form="over r",
        ),
        {"form": "over r/V", "equation": "M = -c r V0/V, V0 = 1 m/s", "fills": {"c": "yaw_damp_v"}},
    ),
    # Judged in the measured speed, which also drives the simulation of all other effects; see
    # posterior.speed_loss.
    SpeedEffect(
        id="speed_variation",
        title="cornering drag lowers the speed",
        equation="V' = (V_set - V)/tau_V - D a_y^2",
        source="front side force times sin(d), for linear tyres",
        parameters=(
            P("D", "s^2/m", 0.02, 0.0, 2.0, "loss of speed per a_y squared", tolerance=0.002, matters=0.01),
        ),
        apart="no other effect changes the speed with the square of a_y",
        next_run="the same sweep with the throttle held by hand, and with the speed controller",
        signed=False,
    ),
)


# Effects of the ground and the wind.
#
# psi: heading [rad], left positive from north; psi0: the heading at which the effect is largest to the left.
# C: cornering stiffness of both axles. Slope and wind are fitted by the cosine and the sine of psi0.


def _by_heading(motion: Motion, cosine: float, sine: float) -> Array:
    """Left component (n,) of a vector fixed to the ground."""
    return cosine * np.cos(motion["psi"]) + sine * np.sin(motion["psi"])


def weight_across(motion: Motion, q: Values, mass: float) -> Force:
    """Lateral part of the weight [N], and its roll moment on the sprung mass about the roll axis [N m]."""
    side = _by_heading(motion, q["b_cos"], q["b_sin"])
    return -mass * GRAVITY * side, 0.0, motion["ms_h"] * GRAVITY * side


def blown(motion: Motion, q: Values, mass: float) -> Force:
    """Side force [N] of a wind on the body, its yaw moment, and its roll moment about the roll axis [N m]."""
    side = _by_heading(motion, q["w_cos"], q["w_sin"])
    return mass * side, q["x"] * mass * side, -motion["ms_h"] * side


def polar(cosine: float, sine: float, size: tuple[str, str, str], largest: str) -> Reported:
    """Two fitted components as size and heading. size: (name, unit, meaning) of the size."""
    name, *words = size
    heading = f"heading, left positive from north, of the largest {largest}"
    return {
        name: (float(np.hypot(cosine, sine)), words[0], words[1]),
        "psi0": (float(np.arctan2(sine, cosine)), "rad", heading),
    }


_RATIO = P("ratio", "-", 0.3, -1.6, 1.6, "C after over C before", "ratio", tolerance=0.015, matters=0.08)
SURROUNDINGS = (
    # The residual begins at t. A repeat of the run on one ground confirms it.
    *family(
        GripEffect(
            id="surface_change",
            title="the ground changed",
            equation="C jumps to ratio C at t",
            source="step change of the cornering stiffness",
            parameters=(_RATIO, P("t", "s", 2.0, 0.0, 1e4, "instant, from the start of the run's manoeuvre")),
            apart="all other effects act during the whole run",
            next_run="repeat the run on one ground",
            act=lambda m, q: np.where(m["t"] >= q["t"], np.exp(q["ratio"]), 1.0),
            baselines=("roll-yaw", "bicycle"),
            in_one_run=True,
            form="for the rest of the run",
        ),
        {
            "form": "from then on",
            "equation": "C jumps to ratio C at t, and stays so",
            "later": lambda q: float(np.exp(q["ratio"])),
        },
        {
            "form": "over ten seconds",
            "equation": "C goes to ratio C from t to t + 10 s, and stays so",
            "act": lambda m, q: np.exp(q["ratio"] * np.clip((m["t"] - q["t"]) / 10.0, 0.0, 1.0)),
            "later": lambda q: float(np.exp(q["ratio"])),
        },
        {
            "form": "one run",
            "equation": "ratio C in one run",
            "parameters": (_RATIO,),
            "act": lambda m, q: np.full(m["t"].size, np.exp(q["ratio"])),
        },
        {
            "form": "all along",
            "in_one_run": False,
            "title": "the ground or the tyres change steadily",
            "equation": "ln C grows by ln ratio in 300 s",
            "source": "tyres that warm up",
            "parameters": (_RATIO,),
            "next_run": "the first run again at the end",
            "act": lambda m, q: np.exp(q["ratio"] * m["driven"] / 300.0),
        },
    ),
    # b: slope. The weight pulls the rover to the low side; the accelerometer measures the tyre force that
    # holds it. Needs a recorded heading; runs in opposite directions show it best.
    ForceEffect(
        id="cross_slope",
        title="the ground slopes",
        equation="a_y + g b cos(psi - psi0)",
        source="Rajamani 2012, chapter 2, road bank angle",
        parameters=(
            P("b_cos", "rad", 0.04, -0.4, 0.4, "b cos(psi0)", tolerance=0.008, matters=0.02),
            P("b_sin", "rad", 0.04, -0.4, 0.4, "b sin(psi0)", tolerance=0.008, matters=0.02),
        ),
        apart="a tilted IMU and a trim do not change with the heading",
        next_run="the same run in the opposite direction",
        act=weight_across,
        weight=True,
        report_values=lambda found: polar(
            found["b_cos"], found["b_sin"], ("b", "rad", "slope of the ground"), "+a_y"
        ),
    ),
    # w: force per mass, on the body at the height of its CG. The accelerometer measures it, unlike the weight
    # on a slope. Needs a heading.
    ForceEffect(
        id="side_wind",
        title="side wind",
        equation="m w cos(psi - psi0)",
        source="Hucho 1998, side wind",
        parameters=(
            P("w_cos", "m/s^2", 0.4, -4.0, 4.0, "w cos(psi0)", tolerance=0.08, matters=0.2),
            P("w_sin", "m/s^2", 0.4, -4.0, 4.0, "w sin(psi0)", tolerance=0.08, matters=0.2),
            P("x", "m", 0.03, -0.1, 0.1, "where it acts, ahead of the CG", grows_with="wheelbase"),
        ),
        apart="turns with the heading as a slope does, but the accelerometer measures it",
        next_run="the same run in the opposite direction, on a calm day",
        act=blown,
        report_values=lambda found: {
            **polar(found["w_cos"], found["w_sin"], ("w", "m/s^2", "side force per mass"), "push left"),
            "x": (found["x"], "m", "where it acts, ahead of the CG"),
        },
        baselines=("roll-yaw", "bicycle"),
    ),
)
