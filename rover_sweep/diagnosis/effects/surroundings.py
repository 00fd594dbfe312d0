"""Effects of the ground and the wind.

psi: heading [rad], left positive from north; psi0: the heading at which the effect is largest to the left. C:
cornering stiffness of both axles. Slope and wind are fitted by the cosine and the sine of psi0.
"""

from __future__ import annotations

import numpy as np

from rover_sweep.data.geometry import GRAVITY
from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.effects.effect import (
    DriftEffect,
    Force,
    ForceEffect,
    GripEffect,
    Motion,
    Reported,
    Values,
    family,
)
from rover_sweep.diagnosis.effects.effect import EffectParameter as P


def _by_heading(motion: Motion, cosine: float, sine: float) -> Array:
    """What turns with the heading (n,), from its two components."""
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
    """What was fitted by two components, for a user. size: (name, unit, meaning) of its size."""
    name, *words = size
    heading = f"heading, left positive from north, of the largest {largest}"
    return {
        name: (float(np.hypot(cosine, sine)), words[0], words[1]),
        "psi0": (float(np.arctan2(sine, cosine)), "rad", heading),
    }


_RATIO = P("ratio", "-", 0.3, -1.6, 1.6, "C after over C before", "ratio", tolerance=0.015, matters=0.08)
LAWS = (
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
            act=lambda t, q: np.where(t >= q["t"], np.exp(q["ratio"]), 1.0),
            baselines=("roll-yaw", "bicycle"),
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
            "act": lambda t, q: np.exp(q["ratio"] * np.clip((t - q["t"]) / 10.0, 0.0, 1.0)),
            "later": lambda q: float(np.exp(q["ratio"])),
        },
        {
            "form": "one run",
            "equation": "ratio C in one run",
            "parameters": (_RATIO,),
            "act": lambda t, q: np.full(t.size, np.exp(q["ratio"])),
        },
        {
            "kind": DriftEffect,
            "form": "all along",
            "title": "the ground or the tyres change all along",
            "equation": "ln C grows by ln ratio in 300 s",
            "source": "tyres that warm up",
            "parameters": (_RATIO,),
            "next_run": "the first run again at the end",
            "act": lambda driven, q: np.exp(q["ratio"] * driven / 300.0),
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
