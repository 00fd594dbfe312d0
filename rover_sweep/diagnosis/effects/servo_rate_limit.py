"""The servo cannot turn faster than its rated speed.

    abs(d') <= R

d: road-wheel angle [rad]. R [rad/s], 1/3 and more (coordinate 1/R). Servos are sold with 0.10 to 0.20 s per
60 deg, 5 to 10 rad/s. The residual power grows about 17 times when the amplitude doubles, so it needs two
amplitudes; a large amplitude at high frequency shows it best. Slew-rate limit.
"""

from __future__ import annotations

from rover_sweep.diagnosis.effects.effect import EffectParameter
from rover_sweep.diagnosis.effects.kinds import ServoEffect

EFFECT = ServoEffect(
    id="servo_rate_limit",
    title="rate limit of the servo",
    equation="abs(d') <= R",
    source="slew-rate limit of RC servos",
    parameters=(
        EffectParameter(
            "R",
            "rad/s",
            0.4,
            0.0,
            3.0,
            "fastest rate of the road wheel's angle",
            form="inverse",
            tolerance=0.03,
            matters=0.25,  # s/rad, slower than 4 rad/s
        ),
    ),
    apart="grows with amplitude and frequency; a lag does not, a cubic gain does not depend on frequency",
    next_run="a second sweep at half the amplitude, or a large step with the rover on blocks",
    fills={"R": "inv_rate"},
    signed=False,
)
