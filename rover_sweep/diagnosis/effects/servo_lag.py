"""The steering servo is slow.

    T d' = u - d

u, d: commanded and true road-wheel angle [rad]. T [s]: time constant, 0 to 0.5. Up to 40 ms, or 70 ms
together with the transport delay, are a normal tolerance of the baseline. One sweep is enough; high
frequencies show it best. First-order lag; the second form swings, with
the damping ratio 1/(2 sqrt(q)), q up to 8, `lag_shape` of the nominal model.
"""

from __future__ import annotations

from dataclasses import replace

from rover_sweep.diagnosis.effects.effect import EffectParameter
from rover_sweep.diagnosis.effects.kinds import NominalEffect

EFFECT = NominalEffect(
    id="servo_lag",
    title="slow steering servo",
    equation="T d' = u - d",
    source="first-order lag; a finding above 40 ms alone or 70 ms with the delay",
    parameters=(
        EffectParameter(
            "T", "s", 0.06, 0.0, 0.5, "time constant of the whole first-order lag", nominal="lag"
        ),
    ),
    apart="a delay changes the phase but not the gain; a rate limit grows with the amplitude",
    next_run="rover on blocks: a step of 100 us, angle of the wheel over time",
    releases={"lag": (0.0, 0.5)},
    form="first order",
)

FORMS = (
    replace(
        EFFECT,
        first=False,
        form="second order",
        title="swinging steering servo",
        equation="q T^2 d'' + T d' + d = u",
        source="second-order servo, damping ratio 1/(2 sqrt(q))",
        releases={"lag": (0.0, 0.5), "lag_shape": (0.0, 8.0)},
    ),
)
