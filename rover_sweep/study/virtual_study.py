"""The study: drive, identify in three ways, verify, and counterfactuals that explain the results."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from rover_sweep.data.geometry import Geometry
from rover_sweep.data.recording import LowPass, Recording
from rover_sweep.identification.cost import Condition, ResponseData
from rover_sweep.identification.fit import FitResult, fit
from rover_sweep.identification.grouping import Group, Settings
from rover_sweep.identification.models.lumped import lumped
from rover_sweep.identification.models.roll_yaw import roll_yaw
from rover_sweep.identification.pipeline import Identification, identify
from rover_sweep.identification.structure.state_space import OUTPUTS, ModelStructure
from rover_sweep.identification.verify import Verification, verify
from rover_sweep.spectra.response import Band, usable_band
from rover_sweep.study.conditions import CHECKS, Progress, StudyRuns, drive_all, geometry
from rover_sweep.study.published import BANDS, SWEEP


@dataclass(frozen=True, eq=False)
class Practice:
    """One way of fitting the same runs. title: for tables. words: its description."""

    key: str
    title: str
    words: str
    result: Identification

    @property
    def group(self) -> Group:
        """The sweeps and their responses."""
        return self.result.groups[0]

    def fit(self, model: str) -> FitResult:
        """The fit of a model."""
        return self.result.models[model].fit

    def check(self, model: str, check: str) -> Verification:
        """The verification of a model on one of CHECKS."""
        return self.result.models[model].verification[list(CHECKS).index(check)]


@dataclass(frozen=True, eq=False)
class Counterfactuals:
    """Fits and verifications with one thing changed, to explain a result.

    frozen: the roll-yaw model written as a lumped one at the identified speed, verified at 4 m/s with V
    only in its kinematic term; untied: the roll-yaw model with Cf and Cr free, on each of CHECKS;
    gyro_ignored: the roll-yaw fit with the accelerometer's low-pass known and the gyro's ignored;
    prompt: the roll-yaw fit with the estimator's velocity lag taken out of V_y'/delta; as_table_4: the
    lumped model with only Table 4's parameters free, filters ignored.
    """

    frozen: Verification
    untied: Mapping[str, Verification]
    gyro_ignored: FitResult
    prompt: FitResult
    as_table_4: FitResult


@dataclass(frozen=True, eq=False)
class Study:
    """All results. truth: the roll-yaw model with the numbers of the virtual rover (tyres at zero slip)."""

    seed: int
    runs: StudyRuns
    geometry: Geometry
    practices: Mapping[str, Practice]
    truth: ModelStructure
    truth_lumped: ModelStructure
    coherent: Mapping[str, Band | None]
    counterfactuals: Counterfactuals

    @property
    def paper(self) -> Practice:
        """The fits made as in the paper."""
        return self.practices["paper"]

    @property
    def known(self) -> Practice:
        """The same fits with the sensors' filters in the models' outputs."""
        return self.practices["known"]


def study(seed: int = 1, progress: Progress | None = None) -> Study:
    """Drives and identifies; the same seed gives the same numbers. progress: share done 0..1, and what."""
    report = progress or _silent
    runs = drive_all(seed, lambda share, what: report(0.35 * share, what))
    known_geometry = geometry(runs.asphalt)
    practices: dict[str, Practice] = {}
    for k, (key, title, words, filtered, fitted) in enumerate(_PRACTICES):
        report(0.35 + 0.2 * k, f"identifying: {title}")
        practices[key] = Practice(key, title, words, _identified(runs, known_geometry, filtered, fitted))
    report(0.95, "explaining")
    known = practices["known"]
    truth = _truth(runs, known_geometry)
    coherent = {o: usable_band(f.w, f.coherence) for o, f in known.group.responses.items()}
    return Study(
        seed,
        runs,
        known_geometry,
        practices,
        truth,
        lumped(known_geometry, truth, known.group.speed),
        coherent,
        _counterfactuals(runs, known_geometry, practices),
    )


_KNOWN = "the sensors' known filters in the models' outputs"
_PRACTICES = (
    ("paper", "as in the paper", "four responses, the sensors' filters ignored", False, OUTPUTS),
    ("known", "filters known", f"four responses, {_KNOWN}", True, OUTPUTS),
    ("default", "without V̇_y", f"r, a_y and p, {_KNOWN}: this tool's default", True, ("r", "ay", "p")),
)


def swept_bands() -> dict[str, Band]:
    """The paper's bands, from the lowest swept frequency up [rad/s]."""
    return {o: (max(low, SWEEP["w_min"]), high) for o, (low, high) in BANDS.items()}


def _silent(share: float, what: str) -> None:
    """Ignores progress."""


def _identified(runs: StudyRuns, known: Geometry, filtered: bool, fitted: Sequence[str]) -> Identification:
    settings = Settings(
        fitted=tuple(fitted), band=(SWEEP["w_min"], SWEEP["w_max"]), bands=swept_bands(), as_paper=True
    )
    sweeps, checks = runs.sweeps, tuple(runs.checks.values())
    if not filtered:
        sweeps, checks = (tuple(_filtered(run, {}) for run in part) for part in (sweeps, checks))
    return identify(sweeps, known, checks, settings)


def _filtered(run: Recording, filters: Mapping[str, LowPass]) -> Recording:
    """The run with only these low-passes known."""
    return replace(run, filters=filters)


def _truth(runs: StudyRuns, known: Geometry) -> ModelStructure:
    rover = runs.asphalt
    return roll_yaw(known, tied=False).with_values(
        {
            "Cf": rover.front_cornering_stiffness,
            "Cr": rover.rear_cornering_stiffness,
            "Izz": rover.yaw_inertia,
            "k_phi": rover.roll_stiffness,
            "b_phi": rover.roll_damping,
            "tau": true_delay(runs),
        }
    )


def true_delay(runs: StudyRuns) -> float:
    """The steering's low-frequency lag [s]: the servo's delay and lag. (The PWM's steps are in the input.)"""
    return runs.asphalt.servo_delay + runs.asphalt.servo_lag


def _counterfactuals(runs: StudyRuns, known: Geometry, practices: Mapping[str, Practice]) -> Counterfactuals:
    best = practices["known"].result.models["roll-yaw"]
    group = practices["known"].group
    frozen = lumped(known, best.fit.structure, group.speed)
    untied = best.variants["Cf and Cr free"].structure
    accelerometer = {c: f for c, f in runs.firmware.filters.items() if c == "ay"}
    condition = replace(group.condition(OUTPUTS), filters=accelerometer)
    return Counterfactuals(
        frozen=verify(frozen, runs.checks["fast"]),
        untied={name: verify(untied, run) for name, run in runs.checks.items()},
        gyro_ignored=fit(best.fit.structure, [condition]),
        prompt=fit(best.fit.structure, [_prompt(group, runs.asphalt.velocity_lag)]),
        as_table_4=_as_table_4(known, practices["paper"]),
    )


def _prompt(group: Group, lag: float) -> Condition:
    """The responses with the estimator's lag [s] removed from V_y'.

    The lag acts on the velocity in earth axes. In body axes it delays V_y and, in a turn, takes lag V r from
    it as well. So V_y' = measured (1 + jw lag) + jw lag V r.
    """
    condition = group.condition(OUTPUTS)
    r = group.responses["r"]

    def mended(d: ResponseData) -> ResponseData:
        turning = r.at(d.w)[0] / condition.filters["r"].response(d.w)
        return replace(d, h=d.h + 1j * d.w * lag * (d.h + group.speed * turning))

    data = tuple(mended(d) if d.output == "vydot" else d for d in condition.data)
    return replace(condition, data=data)


def _as_table_4(known: Geometry, paper: Practice) -> FitResult:
    """The lumped model with the derivatives at zero that Table 4 lists as zero."""
    start = lumped(known, paper.fit("roll-yaw").structure, paper.group.speed)
    for name in ("Y_v", "Y_r", "Y_phi", "L_v", "L_phi"):
        start = start.fixed(name, 0.0)
    return fit(start, [paper.group.condition(OUTPUTS)], stable=True)
