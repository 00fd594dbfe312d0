"""The finding that cornering costs speed, and its test on held-out runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rover_sweep.data.by_name import ByName
from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.effects import library
from rover_sweep.diagnosis.held_out.speed_loss import SpeedLoss, speed_predicted
from rover_sweep.diagnosis.held_out.worth import FittedModel, HeldOutRun, fit_of
from rover_sweep.diagnosis.result import EffectValue, Finding, HeldOut, Unknown
from rover_sweep.diagnosis.simulation.experiment import Experiment

ID = "speed_variation"
LEAST_SHARE = 0.05  # of the held-out speed's error; a loss that is not there removed 0.3 %
WORSE = "fitted to the runs, but it does not predict the speed of the held-out runs"


@dataclass(frozen=True, eq=False)
class AtPredictedSpeed(FittedModel):
    """A model that is driven at a predicted speed instead of the measured one.

    loss: D [s^2/m]; lag [s] of the drive.
    """

    loss: float
    lag: float

    def speed(self, run: Experiment) -> Array:
        """The speed (n,) [m/s] that this loss predicts."""
        return speed_predicted(run, self.model.structure, self.x, self.loss, self.lag)

    def log(self, run: Experiment) -> dict[str, Array]:
        """The simulated log of the run at that speed {channel: (n,)}."""
        return super().log(replace(run, speed=self.speed(run)))


def speed_finding(found: SpeedLoss, whole: FittedModel, unused: Sequence[HeldOutRun]) -> Finding:
    """The loss as a finding. whole: the model with all other effects; unused: the held-out runs."""
    effect = library()[ID]
    unit, meaning = effect.parameters[0].unit, effect.parameters[0].convention
    value = EffectValue("D", unit, found.loss, found.low, found.high, meaning)
    without, with_it = (AtPredictedSpeed(whole.model, whole.x, d, found.lag) for d in (0.0, found.loss))
    sentence = (
        f"{effect.title}, D = {found.loss:.3g} {unit}: up to {100 * found.drop:.1f} % of the speed "
        f"(lag of the drive: {found.lag:.1f} s)"
    )
    shown = tuple(_held_out(held, without, with_it, found.noise) for held in unused)
    return Finding(
        ID,
        (),
        ByName((value,)),
        {"gain": found.gain, "threshold": found.threshold},
        shown,
        effect.next_run,
        sentence,
        effect.equation,
    )


def earned(found: Finding) -> bool:
    """False where held-out runs judge the loss, and it removes less than `LEAST_SHARE` on average."""
    shares = [h.share_removed for h in found.held_out if h.share_removed is not None]
    return not shares or sum(shares) / len(shares) > LEAST_SHARE


def unknown_loss(found: SpeedLoss) -> Unknown:
    """The same loss as an unknown, where the effect is not among the candidates."""
    times = float(np.sqrt(found.gain / found.threshold))
    return Unknown(
        "V",
        "a_y",
        times,
        f"turns cost up to {100 * found.drop:.1f} % of the speed, in proportion to a_y^2 and more than the "
        "drag of the turned wheels; no candidate explains it",
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
