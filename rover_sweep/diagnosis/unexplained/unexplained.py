"""What the answer's model leaves: a channel above the noise, or something that has no name."""

from __future__ import annotations

import numpy as np

from rover_sweep.diagnosis.posterior.infer import Inference
from rover_sweep.diagnosis.result import Unknown

NOTABLE = 1.45  # mean square of a channel's rows from which its residual must be explained
PROBABLE = 0.5  # of something else, from which it is an answer
CHANNELS = {
    "r": "the yaw rate",
    "ay": "the lateral acceleration",
    "p": "the roll rate",
    "vy": "the lateral velocity",
}


def left_unexplained(found: Inference, named: bool) -> Unknown | None:
    """The misfit of the final model, None where it is at the noise floor and nothing else is probable.

    named: effects were found.
    """
    misfit = found.last.misfit
    channel = max(misfit, key=lambda c: misfit[c])
    probable = found.posterior.something_else > PROBABLE
    if misfit[channel] <= NOTABLE and not probable:
        return None
    ratio = float(np.sqrt(misfit[channel]))
    still = "still " if named else ""
    sentence = f"{CHANNELS[channel]} {still}differs from the simulation by {ratio:.2g} times the noise"
    if misfit[channel] <= NOTABLE:
        sure = 100 * found.posterior.something_else
        sentence = f"an effect that is not in the list is missing ({sure:.0f} %)"
    return Unknown(channel, "nothing that was tried", ratio, f"{sentence}; no candidate explains it")
