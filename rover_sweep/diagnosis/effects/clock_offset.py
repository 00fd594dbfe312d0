"""The clocks that time-stamp steering and motion disagree.

    angle that acts at t = u(t - T - 0.02 s)

u: commanded road-wheel angle [rad]. T [s]: the steering's time stamps are late by T. The vehicle has no part
in it. T cannot be separated from the delay of the steering itself, so 20 ms are taken as the steering's own.
Bounds: -0.5 to 0.5 s. Needs data of two clocks; high frequencies show it best.
"""

from __future__ import annotations

from rover_sweep.diagnosis.effects.effect import EffectParameter, Reported, Values
from rover_sweep.diagnosis.effects.kinds import NominalEffect

USUAL_DELAY = 0.02  # s, of the steering itself


def late_stamps(found: Values) -> Reported:
    """The offset [s], less the usual delay of the steering."""
    return {"T": (USUAL_DELAY - found["T"], "s", "the time stamps of the steering are late by T")}


EFFECT = NominalEffect(
    id="clock_offset",
    title="clocks of steering and motion disagree",
    equation="u(t - T), the vehicle has no part in it",
    source="definition of a time offset",
    parameters=(
        EffectParameter(
            "T",
            "s",
            0.06,
            -0.5,
            0.5,
            "the time stamps of the steering are early by T",
            doubt=0.01,  # the usual delay is between 0 and 40 ms
            nominal="delay",
        ),
    ),
    apart="possible only with two clocks in the data; it may change from run to run, a delay does not",
    next_run="read the DataFlash log of the same run, in which one clock stamps everything",
    releases={"delay": (-0.5, 0.5)},
    report_values=late_stamps,
)
