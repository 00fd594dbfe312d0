"""What a diagnosis says, frozen; `rover_sweep.report` writes it down, nothing here computes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rover_sweep.diagnosis.simulation.augmented import AugmentedModel

Array = NDArray[np.float64]
Verdict = Literal["none", "explained", "partly explained", "unexplained", "refused"]
THROUGHOUT = "throughout"  # condition of a mismatch that has none


@dataclass(frozen=True)
class Profile:
    """What the residual depends on, for a small picture: its size in noise floors over one quantity.

    over: what stands along the axis ("frequency", "amplitude", "speed", "time", "heading", "turn",
    "harmonic"); unit: of it, "" for words. x: (n,) its values, or words such as "left"; ratio: (n,).
    """

    over: str
    unit: str
    x: tuple[float, ...] | tuple[str, ...]
    ratio: tuple[float, ...]


@dataclass(frozen=True)
class Mismatch:
    """A place where simulation and recording differ, in sizes of the noise floor.

    channel: r, ay, p or vy. band [rad/s]. condition: of what the place is a part, in words ("240 us",
    "1.65 m/s", "left turns", "3rd harmonic", "from 31 s on", "heading east", "throughout").
    residual_over_noise: rms of the residual there over rms of the noise there. profile: for its picture.
    """

    channel: str
    band: tuple[float, float]
    condition: str
    residual_over_noise: float
    sentence: str
    profile: Profile | None = None


@dataclass(frozen=True)
class EffectValue:
    """A parameter of a named effect with its 90 % interval; low, high None where none could be found."""

    name: str
    unit: str
    value: float
    low: float | None
    high: float | None
    meaning: str = ""


@dataclass(frozen=True)
class Fit:
    """Fit of a model to one run: J_rms, TIC, and where the run is a sweep J per response (empty otherwise).

    cost: {output: J} of r, ay, vydot, p, over the band in which the recording is coherent.
    """

    j_rms: float
    tic: float
    cost: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class HeldOut:
    """Before and after on a run that neither the fit nor the choice used.

    share_removed: (RSS before - RSS after)/(RSS before - noise floor), None where before is at the floor.
    """

    run: str
    before: Fit
    after: Fit
    share_removed: float | None


@dataclass(frozen=True)
class Finding:
    """One effect that was left out, the effects that would explain it as well, and what tells them apart.

    evidence: {name: number}: gain (drop of the whitened cost), threshold (bootstrap), cosine with
    "cosine:<id>" for each look-alike.
    held_out: the whole model against the same without this effect, the rest of it fitted again: what the
    effect is worth in the presence of all others. With a single finding it is the total.
    """

    effect: str
    look_alikes: tuple[str, ...]
    parameters: tuple[EffectValue, ...]
    evidence: Mapping[str, float]
    held_out: tuple[HeldOut, ...]
    next_run: str
    sentence: str
    equation: str


@dataclass(frozen=True)
class Unknown:
    """Something that no candidate explains: where it is, what it depends on, what law it looks like."""

    channel: str
    depends_on: str
    residual_over_noise: float
    sentence: str
    law: str = ""
    law_gain: float | None = None


@dataclass(frozen=True)
class Unseen:
    """An effect that these runs cannot show, or not apart from another, and why."""

    effect: str
    why: str


@dataclass(frozen=True)
class Falsified:
    """A parameter of the nominal model that the missing effect had falsified."""

    name: str
    unit: str
    before: float
    after: float


@dataclass(frozen=True, eq=False)
class Overlay:
    """Measured against simulated, before and after, for the pictures.

    run, channel; held_out: the run was not used; t (n,) s; measured, before, after (n,) SI; noise: rms of
    the floor, SI. spectra: w (k,) rad/s and the residual's power over the noise's, before and after (k,).
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
class Diagnosis:
    """The whole answer.

    baseline: the model that something was left out of. parameters: the nominal model refitted together
    with the effects, {name: EffectValue}. scores: {effect: gain of the first round} of all candidates.
    sentence: the answer in one sentence. remarks: what the reader should know of the data (one each).
    """

    verdict: Verdict
    sentence: str
    baseline: str
    mismatch: tuple[Mismatch, ...] = ()
    findings: tuple[Finding, ...] = ()
    unknown: Unknown | None = None
    cannot_see: tuple[Unseen, ...] = ()
    falsified: tuple[Falsified, ...] = ()
    parameters: tuple[EffectValue, ...] = ()
    scores: Mapping[str, float] = field(default_factory=dict)
    overlays: tuple[Overlay, ...] = ()
    held_out: tuple[HeldOut, ...] = ()
    remarks: tuple[str, ...] = ()
    seconds: float = 0.0
    runs: tuple[str, ...] = ()
    held_out_runs: tuple[str, ...] = ()
    model: AugmentedModel | None = None
    """The nominal model with the effects, to simulate and export; None where the data were refused."""
