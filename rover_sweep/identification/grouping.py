"""Runs of one speed share their frequency responses; a fit may take several speeds at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from rover_sweep.data.recording import Recording
from rover_sweep.identification.cost import Condition, sampled
from rover_sweep.quality.coherence import input_responses, sign_is_wrong
from rover_sweep.spectra.conditioned import entanglement, moving
from rover_sweep.spectra.response import Band, FrequencyResponse

MODELS = ("bicycle", "roll-yaw", "lumped")
FITTED = ("r", "ay", "p")
SAME_SPEED = 0.10  # runs within 10 % share their responses


@dataclass(frozen=True)
class Settings:
    """How to identify. models of MODELS; fitted responses; tied: one C for both axles.

    reduction: drop what the data cannot tell, but none of the parameters in keep.
    band [rad/s]: swept range; bands: usable band per response; windows [s]: all found from the data
    when None. condition_on: channels that move the rover beside the steering, such as "throttle", which
    are taken out of every response. bootstrap: replicates for the intervals of the parameters, 0: none.
    """

    models: tuple[str, ...] = MODELS
    fitted: tuple[str, ...] = FITTED
    tied: bool = True
    band: Band | None = None
    bands: Mapping[str, Band] = field(default_factory=dict)
    windows: tuple[float, ...] | None = None
    reduction: bool = True
    keep: tuple[str, ...] = ()
    condition_on: tuple[str, ...] = ()
    bootstrap: int = 0


@dataclass(frozen=True, eq=False)
class Group:
    """Runs at one speed [m/s] and their composite responses {output: response} to the steering.

    others: {input: {output: response}} of the inputs that the responses are conditioned on; remarks:
    what is to be said on these inputs.
    """

    speed: float
    runs: tuple[Recording, ...]
    responses: Mapping[str, FrequencyResponse]
    others: Mapping[str, Mapping[str, FrequencyResponse]] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()

    def condition(self, outputs: Sequence[str], filtered: bool = True) -> Condition:
        """What the cost sees of these responses (those with a usable band)."""
        found = [r[o] for r in (self.responses, *self.others.values()) for o in outputs if o in r]
        data = tuple(sampled(f, f.band) for f in found if f.band)
        return Condition(self.speed, data, self.runs[0].filters if filtered else {})

    def usable(self, output: str) -> bool:
        """True when the output was recorded and has a usable band."""
        return output in self.responses and self.responses[output].band is not None

    def why_not(self) -> str | None:
        """The reason why nothing can be identified from these runs, or None."""
        r = self.responses.get("r")
        if r is None or r.band is None:
            best = "no yaw rate was recorded" if r is None else f"highest coherence {np.max(r.coherence):.2f}"
            return f"nothing can be identified: no band where the yaw rate follows the steering ({best})"
        if sign_is_wrong(r):
            return (
                "the rover turns against the recorded steering angle: the sign of rad_per_us in the vehicle "
                "file is wrong for this linkage, so give it the other sign"
            )
        return None


def grouped(runs: Sequence[Recording], settings: Settings) -> tuple[Group, ...]:
    """Runs in groups of equal sensor filters and mean speeds within 10 % of the first of the group."""
    groups: list[list[Recording]] = []
    for run in runs:
        near = [g for g in groups if _alike(run, g[0])]
        if near:
            near[0].append(run)
        else:
            groups.append([run])
    return tuple(_group(g, settings) for g in groups)


def _alike(a: Recording, b: Recording) -> bool:
    """True for runs at one speed behind the same sensor low-passes."""
    cutoffs = [{c: f.cutoff_hz for c, f in run.filters.items()} for run in (a, b)]
    return abs(a.mean_speed / b.mean_speed - 1) <= SAME_SPEED and cutoffs[0] == cutoffs[1]


def _group(runs: Sequence[Recording], settings: Settings) -> Group:
    inputs = ("delta", *(c for c in settings.condition_on if moving(runs, c)))
    found, *others = input_responses(
        runs, inputs, band=settings.band, windows=settings.windows, bands=settings.bands
    ).values()
    lengths = [run.span[1] - run.span[0] for run in runs]
    speed = float(np.average([run.mean_speed for run in runs], weights=lengths))
    return Group(
        speed,
        tuple(runs),
        found,
        dict(zip(inputs[1:], others, strict=True)),
        _remarks(found, settings.condition_on, inputs),
    )


def _remarks(
    found: Mapping[str, FrequencyResponse], wanted: Sequence[str], inputs: Sequence[str]
) -> tuple[str, ...]:
    still = [
        f"{c} stands still in these runs, so there is nothing to condition on"
        for c in wanted
        if c not in inputs
    ]
    entangled = [words for o in ("r", "ay") if o in found and (words := entanglement(found[o]))]
    return (*still, *entangled[:1])
