"""Groups of runs at one speed, which share their frequency responses; a fit may use several groups."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from rover_sweep.data.recording import Recording
from rover_sweep.data.results import PlainNumbers
from rover_sweep.data.vehicle_file import MODELS
from rover_sweep.identification.fit import Condition, sampled
from rover_sweep.quality.coherence import input_responses, sign_is_wrong
from rover_sweep.spectra.response import Band, FrequencyResponse, correlated_inputs, moving
from rover_sweep.spectra.side_by_side import side_by_side

FITTED = ("r", "ay", "p")
SAME_SPEED = 0.10  # relative difference of mean speeds within a group
VARIED = 0.15  # standard deviation of the speed over its mean, from which a run has no single speed


@dataclass(frozen=True)
class Settings:
    """Settings of an identification.

    models: names in MODELS. fitted: outputs in the cost. tied: one cornering stiffness C for both axles;
    as_paper: even if separate ones fit much better.
    band [rad/s]: swept range; bands [rad/s]: usable band per output; windows [s]: lengths; each is found from
    the data if not given. reduction: fix parameters that the data cannot determine, except those in keep.
    condition_on: further inputs, such as "throttle", whose effect is removed from every response. bootstrap:
    number of replicates for confidence intervals, 0: none.
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
    as_paper: bool = False


@dataclass(frozen=True, eq=False)
class Group(PlainNumbers):
    """Runs at one speed [m/s], negative in reverse, and their composite responses to the steering.

    responses: {output: response}.

    others: {input: {output: response}} of the inputs that the responses are conditioned on; remarks:
    sentences about these inputs.
    """

    speed: float
    runs: tuple[Recording, ...]
    responses: Mapping[str, FrequencyResponse]
    others: Mapping[str, Mapping[str, FrequencyResponse]] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()

    def condition(self, outputs: Sequence[str], filtered: bool = True) -> Condition:
        """Data of the cost: these outputs, where they have a usable band.

        filtered: the model includes the known low-passes of the sensors.
        """
        found = [r[o] for r in (self.responses, *self.others.values()) for o in outputs if o in r]
        data = tuple(sampled(f, f.band) for f in found if f.band)
        return Condition(self.speed, data, self.runs[0].filters if filtered else {})

    def usable(self, output: str) -> bool:
        """True when the output was recorded and has a usable band."""
        return output in self.responses and self.responses[output].band is not None

    def left_out(self, why: str) -> str:
        """Sentence on the runs left out, and why."""
        return f"left out {', '.join(run.name for run in self.runs)} at {self.speed:.2f} m/s: {why}"

    def why_not(self) -> str | None:
        """A sentence on why nothing can be identified from these runs, or None."""
        r = self.responses.get("r")
        if r is None or r.band is None:
            best = "no yaw rate was recorded" if r is None else f"highest coherence {np.max(r.coherence):.2f}"
            return (
                f"nothing can be identified: the yaw rate follows the steering in no frequency band ({best})"
            )
        if sign_is_wrong(r, self.speed):
            return (
                "the rover turns opposite to the recorded steering angle: change the sign of rad_per_us in "
                "the vehicle file"
            )
        return None


def grouped(runs: Sequence[Recording], settings: Settings) -> tuple[Group, ...]:
    """Runs in groups of equal sensor filters, with mean speeds within 10 % of the first run of the group.

    Groups in reverse, of a negative speed, come last.
    """
    cutoffs = [{c: f.cutoff_hz for c, f in run.filters.items()} for run in runs]
    found: dict[int, list[Recording]] = {}
    for i, run in enumerate(runs):
        same = (
            k
            for k in found
            if abs(run.mean_speed / runs[k].mean_speed - 1) <= SAME_SPEED and cutoffs[i] == cutoffs[k]
        )
        found.setdefault(next(same, i), []).append(run)
    ordered = sorted(found.values(), key=lambda some: some[0].mean_speed < 0)
    return tuple(side_by_side(lambda g: _group(g, settings), ordered))


def steered_speed(run: Recording) -> float:
    """The speed [m/s] at which the run was steered.

    The mean speed; where the speed varies, as on a race track, it is weighted with the steering's power,
    because a car steers most where it is slow: r = V delta/L gives sum(V delta^2)/sum(delta^2).
    """
    speed = run.manoeuvre("speed")
    mean = run.mean_speed
    if speed.t.size < 3 or float(np.std(speed.x)) < VARIED * abs(mean):
        return mean
    grid = np.linspace(speed.t[0], speed.t[-1], min(speed.t.size, 20_000))
    power = (run["delta"].on(grid) - float(np.mean(run["delta"].on(grid)))) ** 2
    v = speed.on(grid)
    return float(np.sum(power * v) / np.sum(power)) if np.sum(power) > 0 else mean


def _group(runs: Sequence[Recording], settings: Settings) -> Group:
    inputs = ("delta", *(c for c in settings.condition_on if moving(runs, c)))
    found, *others = input_responses(
        runs, inputs, band=settings.band, windows=settings.windows, bands=settings.bands
    ).values()
    lengths = [run.span[1] - run.span[0] for run in runs]
    speed = float(np.average([steered_speed(run) for run in runs], weights=lengths))
    still = [
        f"{c} is constant in these runs, so the responses are not conditioned on it"
        for c in settings.condition_on
        if c not in inputs
    ]
    correlated = [text for o in ("r", "ay") if o in found and (text := correlated_inputs(found[o]))]
    remarks = (*still, *correlated[:1])
    return Group(speed, tuple(runs), found, dict(zip(inputs[1:], others, strict=True)), remarks)
