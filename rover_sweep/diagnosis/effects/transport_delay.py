"""The steering has a pure delay.

    d(t) = u(t - T)

u, d: commanded and true road-wheel angle [rad]. T [s], 0 to 0.5. Up to 40 ms, or 70 ms together with the
servo lag, are a normal tolerance of the baseline. One sweep with known sensor filters is enough; high
frequencies show it best. Pure time delay.
"""

from __future__ import annotations

from rover_sweep.diagnosis.effects.effect import EffectParameter
from rover_sweep.diagnosis.effects.kinds import NominalEffect

EFFECT = NominalEffect(
    id="transport_delay",
    title="transport delay of the steering",
    equation="d(t) = u(t - T)",
    source="pure delay; a finding above 40 ms alone or 70 ms with the servo lag",
    parameters=(EffectParameter("T", "s", 0.06, 0.0, 0.5, "the whole pure delay", nominal="delay"),),
    apart="a servo lag lowers the gain as well as the phase",
    next_run="rover on blocks: a step of 100 us, time until the wheel moves",
    releases={"delay": (0.0, 0.5)},
)
