"""The finding that cornering takes speed, and what it is worth on a run that was not used."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.effects import library
from rover_sweep.diagnosis.held_out.speed_loss import SpeedLoss, speed_predicted
from rover_sweep.diagnosis.held_out.worth import FittedModel, HeldOutRun, fit_of
from rover_sweep.diagnosis.result import EffectValue, Finding, HeldOut, Unknown
from rover_sweep.diagnosis.simulation.experiment import Experiment

ID = "speed_variation"


@dataclass(frozen=True, eq=False)
class AtPredictedSpeed(FittedModel):
    """A model that is driven at a predicted speed, instead of the measured one."""

    loss: float
    lag: float

    def speed(self, run: Experiment) -> Array:
        """The speed (n,) m/s that this loss predicts."""
        return speed_predicted(run, self.model.structure, self.x, self.loss, self.lag)

    def log(self, run: Experiment) -> dict[str, Array]:
        """What the run's log would hold at that speed."""
        return super().log(replace(run, speed=self.speed(run)))


def speed_finding(found: SpeedLoss, whole: FittedModel, unused: Sequence[HeldOutRun]) -> Finding:
    """The loss as a finding. whole: the model with all other effects."""
    effect = library()[ID]
    unit, meaning = effect.parameters[0].unit, effect.parameters[0].convention
    value = EffectValue("D", unit, found.loss, found.low, found.high, meaning)
    without, with_it = (AtPredictedSpeed(whole.model, whole.x, d, found.lag) for d in (0.0, found.loss))
    told = (
        f"{effect.title}, D = {found.loss:.3g} {unit}: up to {100 * found.drop:.1f} % of the speed, "
        f"behind a drive of {found.lag:.1f} s"
    )
    shown = tuple(_held_out(held, without, with_it, found.noise) for held in unused)
    return Finding(
        ID,
        (),
        (value,),
        {"gain": found.gain, "threshold": found.threshold},
        shown,
        effect.next_run,
        told,
        effect.equation,
    )


def unknown_loss(found: SpeedLoss) -> Unknown:
    """The same loss where the effect is not among the candidates."""
    times = float(np.sqrt(found.gain / found.threshold))
    return Unknown(
        "V",
        "a_y",
        times,
        f"up to {100 * found.drop:.1f} % of the speed goes with a_y, beyond what the turned wheels take; no "
        "candidate explains it",
        "V' ~ a_y^2",
    )


def _held_out(
    held: HeldOutRun, without: AtPredictedSpeed, with_it: AtPredictedSpeed, noise: float
) -> HeldOut:
    """J_rms and TIC of models driven at the predicted speeds; the share is that of the speed's own error."""
    run = held.run
    before, after = (float(np.var(run.speed - m.speed(run))) for m in (without, with_it))
    share = (before - after) / (before - noise) if before > noise else None
    return HeldOut(run.name, fit_of(held, without), fit_of(held, with_it), share)
