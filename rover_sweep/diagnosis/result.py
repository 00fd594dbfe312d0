"""The result of a diagnosis as frozen values; `rover_sweep.report` writes it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import log
from typing import Literal

import numpy as np

from rover_sweep.data.codec import in_json
from rover_sweep.data.geometry import Tolerances
from rover_sweep.data.recording import Array
from rover_sweep.data.results import ByName, PlainNumbers, Quantity, ShortTable, Shown
from rover_sweep.diagnosis.simulation.augmented import AugmentedModel

Verdict = Literal["none", "explained", "partly explained", "unexplained", "refused"]
THROUGHOUT = "throughout"  # condition of a mismatch that is not limited to a part of the data


@dataclass(frozen=True)
class Profile(PlainNumbers):
    """The residual over one quantity, for a small picture.

    over: the quantity ("frequency", "amplitude", "speed", "time", "heading", "turn", "harmonic", "run");
    unit: its unit, "" for words. x: (n,) values, or words such as "left"; ratio: (n,) rms over noise; for
    "heading" the fitted part over it, positive to the left.
    """

    over: str
    unit: str
    x: tuple[float, ...] | tuple[str, ...]
    ratio: tuple[float, ...]


@dataclass(frozen=True)
class Mismatch(PlainNumbers):
    """A place where simulation and recording differ.

    channel: r, ay, p or vy. band [rad/s]. condition: the part of the data, in words ("240 us", "1.65 m/s",
    "left turns", "3rd harmonic", "from 31 s on", "heading east", "throughout"). residual_over_noise: rms of
    the residual there over rms of the noise there. profile: for its picture.
    """

    channel: str
    band: tuple[float, float]
    condition: str
    residual_over_noise: float
    sentence: str
    profile: Profile | None = None


in_json(Profile, ratio="residual_over_noise")
in_json(Mismatch, sparse=("profile",), band="band_rad_s")


@dataclass(frozen=True)
class Fit(PlainNumbers):
    """Fit of a model to one run: J_rms and TIC (equations (15) and (16) of the paper).

    cost: {output: J} (equation (11)) of r, ay, vydot and p of a sweep, over the bands in which the recording
    is coherent; empty for other runs.
    """

    j_rms: float
    tic: float
    cost: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class HeldOut(PlainNumbers):
    """Fit before and after on a run that neither the fit nor the selection used.

    share_removed: (RSS before - RSS after)/(RSS before - noise floor), None where `before` is at the floor.
    """

    run: str
    before: Fit
    after: Fit
    share_removed: float | None


@dataclass(frozen=True, repr=False)
class Finding(PlainNumbers, Shown):
    """One missing effect with its look-alikes: effects that explain the residual nearly as well.

    parameters: by name, as in diagnosis.json: parameters["b"].value.

    evidence: {name: number}: "gain" (drop of the whitened cost by the effect) and "probability:<id>" of each
    look-alike. held_out: the full model against the refitted model without this effect; with a single
    finding, against the nominal model. next_run: the run that would decide. form: the effect's law that fits
    the data best, "" if it has only one. probability: that this effect is present and matters, see
    `posterior.weights`; None where it is not known.
    """

    effect: str
    look_alikes: tuple[str, ...]
    parameters: ByName[Quantity]
    evidence: Mapping[str, float]
    held_out: tuple[HeldOut, ...]
    next_run: str
    sentence: str
    equation: str
    form: str = ""
    probability: float | None = None
    turn: str = ""  # what it does to a turn, in plain figures

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "parameters", ByName(self.parameters))

    def table(self) -> ShortTable:
        """Parameters, sentence and effect on a turn."""
        return self.parameters.table(self.effect, tuple(filter(None, (self.sentence, self.turn))))


@dataclass(frozen=True)
class LawCurve(PlainNumbers):
    """A law in the model: y over x with its 90 % band, at one place of the equations.

    place: "steering", "side force front", "side force rear", "side force", "yaw moment", "roll moment",
    "speed" or "sensor of r" (ay, p, vy). alternatives: other places that explain nearly as much. over: the
    quantity x, in `over_unit`; y in `unit`. times: factor of y, "" for none. memory: "" for none, "lag" or
    "play" of `size`, see `simulation.table_law`. gain: drop of chi-squared. "resonance": y is the gain over
    the frequency x of a resonator of `size` [Hz] that `over` drives.
    """

    place: str
    alternatives: tuple[str, ...]
    over: str
    over_unit: str
    unit: str
    x: tuple[float, ...]
    y: tuple[float, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    gain: float
    times: str = ""
    memory: str = ""
    size: float = 0.0
    damping: float = 0.0

    def straight(self, x: Sequence[float]) -> list[float]:
        """The line through the curve's middle with its slope there, at x."""
        own, y = np.array(self.x), np.array(self.y)
        turn = int(np.argmax(own)) + 1  # a curve with a loop goes back from here
        middle = int(np.argmin(np.abs(own[:turn])))
        if turn < own.size:  # a loop has two values in its middle: the line between its ends
            slope = (y[turn - 1] - y[0]) / (own[turn - 1] - own[0])
            return [float(slope * (one - own[0]) + y[0]) for one in x]
        slope = np.gradient(y, own)[middle]
        return [float(slope * (one - own[middle]) + y[middle]) for one in x]

    @property
    def bend(self) -> float:
        """Largest distance of the curve from its straight line, over its largest value."""
        return float(np.max(np.abs(np.array(self.y) - self.straight(self.x))) / np.max(np.abs(self.y)))


@dataclass(frozen=True)
class LawHeldOut(PlainNumbers):
    """A held-out run without and with the curves: mean square residual, 1 at the noise floor.

    share_left: (after - 1)/(before - 1), None where `before` is at the floor.
    """

    run: str
    before: float
    after: float
    share_left: float | None


@dataclass(frozen=True)
class Unknown(PlainNumbers):
    """A misfit that no candidate explains.

    channel: where it is. depends_on: functions of the state, a condition or a parameter. law: fitted terms,
    "place ~ function + ..."; law_gain: share of the held-out residual above the floor that they predict.
    place, alternatives: of the first curve. curves: in the model; empty if they fail on held-out data.
    could_be, next_run: a possible cause and the run that would tell more, in words.
    """

    channel: str
    depends_on: str
    residual_over_noise: float
    sentence: str
    law: str = ""
    law_gain: float | None = None
    place: str = ""
    alternatives: tuple[str, ...] = ()
    curves: tuple[LawCurve, ...] = ()
    held_out: tuple[LawHeldOut, ...] = ()
    could_be: str = ""
    next_run: str = ""


@dataclass(frozen=True)
class UpperBound(PlainNumbers):
    """Possible values (95 %), in `unit`, of a parameter of an effect not found.

    low, high: its range, None: no limit. matters: smaller sizes are normal tolerance;
    None: every size counts.
    """

    unit: str
    low: float | None
    high: float | None
    matters: float | None = None

    @property
    def value(self) -> float | None:
        """The end farthest from no effect; for ratios, the end farthest from 1."""
        if self.low is None or self.high is None:
            return self.high if self.low is None else self.low
        if self.low > 0.0:
            return max(self.low, self.high, key=lambda v: abs(log(v)))
        return max(self.low, self.high, key=abs)


@dataclass(frozen=True)
class Unseen(PlainNumbers):
    """An effect that these runs cannot show, or cannot separate from another, and why.

    up_to: {parameter: range that these runs do not exclude}; empty where they exclude nothing. change: the
    larger change of r or a_y in these runs, from the effect's normal tolerance to that bound; rms over rms,
    simulated without noise. material: the bound is above the size that matters.
    """

    effect: str
    why: str
    up_to: Mapping[str, UpperBound] = field(default_factory=dict)
    change: float | None = None
    material: bool = True


NOTICED = 0.05  # of r or a_y: from there, a turn or a gain is noticeably another


def changes_turns(u: Unseen) -> bool:
    """Whether the effect, at the size that is not excluded, would noticeably change turns and gains."""
    return bool(u.up_to) and u.material and (u.change or 0.0) >= NOTICED


def largest_hidden(unseen: Sequence[Unseen], number: int = 5) -> list[Unseen]:
    """The effects that could still change turns noticeably, the largest change of r or a_y first."""
    return sorted(filter(changes_turns, unseen), key=lambda u: -(u.change or 0.0))[:number]


@dataclass(frozen=True)
class Falsified(PlainNumbers):
    """A nominal parameter that changes when the missing effects are added, in `unit`."""

    name: str
    unit: str
    before: float
    after: float


@dataclass(frozen=True, eq=False)
class TimeHistory(PlainNumbers):
    """Measured and simulated signals before and after, for the pictures.

    held_out: the run was not used. t (n,) [s]; measured, before, after (n,) SI units; noise: rms of the
    floor, SI unit. w (k,) [rad/s]; residual_before, residual_after (k,): residual power over the noise.
    """

    run: str
    channel: str
    held_out: bool
    t: Array
    measured: Array
    before: Array
    after: Array
    noise: float
    w: Array
    residual_before: Array
    residual_after: Array


@dataclass(frozen=True, eq=False)
class Diagnosis(PlainNumbers):
    """The result of a diagnosis.

    sentence: the answer in one sentence. baseline: the model that was tested. parameters: those of the
    nominal model, refitted with the effects. curves: of the tyres, and where an effect acts. scores:
    {effect: drop of chi-squared with it alone}. p_none: probability that no effect that matters is missing;
    p_else: that something unnamed is.
    held_out: nominal and full model on each held-out run. remarks: on the data. seconds: computing time.
    """

    verdict: Verdict
    sentence: str
    baseline: str
    mismatch: tuple[Mismatch, ...] = ()
    findings: tuple[Finding, ...] = ()
    unknown: Unknown | None = None
    cannot_see: tuple[Unseen, ...] = ()
    falsified: tuple[Falsified, ...] = ()
    parameters: ByName[Quantity] = ByName()
    curves: tuple[LawCurve, ...] = ()
    scores: Mapping[str, float] = field(default_factory=dict)
    overlays: tuple[TimeHistory, ...] = ()
    held_out: tuple[HeldOut, ...] = ()
    remarks: tuple[str, ...] = ()
    seconds: float = 0.0
    runs: tuple[str, ...] = ()
    held_out_runs: tuple[str, ...] = ()
    p_none: float | None = None
    p_else: float | None = None
    model: AugmentedModel | None = None
    """The nominal model with the effects, for simulation and export; None if the data were refused."""

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "parameters", ByName(self.parameters))


# The settings of a diagnosis.


Baseline = Literal["roll-yaw", "bicycle", "lumped", "kinematic"]
BASELINES: tuple[Baseline, ...] = ("roll-yaw", "bicycle", "lumped", "kinematic")

START = ("Izz", "k_phi", "b_phi", "C", "Cf", "Cr")  # parameters of a model that the fit begins from, above 0


@dataclass(frozen=True)
class DiagnosisSettings:
    """Settings. baseline: the model to test, None for the most complete one that the runs determine.

    with_effects: the only candidates, empty for all; without_effects: ids to exclude. time_limit [s]: the
    diagnosis ends with the results so far, None for no limit. seed: of the bootstrap. parameters: {name: SI
    value} of an identified model as start values, empty to find them from the runs. spread: normal
    tolerances of a rover against its vehicle file.
    """

    baseline: Baseline | None = None
    with_effects: tuple[str, ...] = ()
    without_effects: tuple[str, ...] = ()
    time_limit: float | None = None
    seed: int = 1
    parameters: Mapping[str, float] = field(default_factory=dict)
    spread: Tolerances = Tolerances()

    def candidates(self, known: tuple[str, ...]) -> tuple[str, ...]:
        """The ids of the known effects that these settings select, in their order."""
        chosen = self.with_effects or known
        return tuple(e for e in known if e in chosen and e not in self.without_effects)
