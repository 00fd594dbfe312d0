"""Runs of a plan, each simulated once, and what a diagnosis of sets of them is expected to tell."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from rover_sweep.data.geometry import Geometry
from rover_sweep.data.tolerances import Tolerances
from rover_sweep.diagnosis.effects import Effect
from rover_sweep.diagnosis.plans.expected_posterior import NONE, Expected, RunSet, expected
from rover_sweep.diagnosis.plans.plan_result import PlannedRun, SimilarPair
from rover_sweep.diagnosis.plans.proposals import as_experiment, run_text
from rover_sweep.diagnosis.plans.run_evidence import (
    NOISE,
    Assumed,
    Basis,
    RunEvidence,
    assumed,
    basis,
    evidence,
)
from rover_sweep.diagnosis.posterior.infer import SHARE, SURE
from rover_sweep.diagnosis.result import Unseen
from rover_sweep.diagnosis.simulation.candidates import Model, possible
from rover_sweep.diagnosis.simulation.experiment import Experiment
from rover_sweep.diagnosis.simulation.simulator import Sensors, logged

Progress = Callable[[str, float], None]


@dataclass(frozen=True, eq=False)
class SetResult:
    """What a set of runs is expected to tell. expected: with each asked effect at its size as the truth.

    sure: {asked effect: its expected probability where it is the truth}.
    """

    expected: Expected
    sure: Mapping[str, float]

    @property
    def bits(self) -> float:
        """Expected information on the explanations [bit]."""
        return self.expected.information()

    @property
    def separated(self) -> tuple[str, ...]:
        """The asked effects that are expected to be named."""
        return tuple(e for e, p in self.sure.items() if p >= SURE)

    @property
    def look_alikes(self) -> tuple[SimilarPair, ...]:
        """The asked effects that are not, with those that share their probability, the largest first."""
        pairs = [
            SimilarPair(e, other, p)
            for e, row in zip(self.expected.truths, self.expected.shares, strict=True)
            if e in self.sure and e not in self.separated and row[NONE] < SHARE
            for other, p in row.items()
            if other != e and p >= SHARE
        ]
        return tuple(sorted(pairs, key=lambda pair: -pair.probability))


@dataclass(eq=False)
class Planner:
    """Simulates each run once, and judges sets of them.

    wanted: effects that must be named, empty for all. driven: {run name: recorded run}. settled: {effect: why
    it is not looked for}.
    """

    rover: Geometry
    rad_per_us: float
    wanted: Sequence[str]
    spread: Tolerances
    driven: Mapping[str, Experiment]
    progress: Progress
    settled: Mapping[str, str] = field(default_factory=dict)
    _evidence: dict[PlannedRun, RunEvidence] = field(default_factory=dict)
    _bases: dict[PlannedRun, Basis] = field(default_factory=dict)

    @cached_property
    def model(self) -> Model:
        """The baseline with the most physics that the vehicle file has the numbers for."""
        whole = bool(self.rover.sprung_mass and self.rover.h and self.rover.roll_inertia)
        clocks = any(run.two_clocks for run in self.driven.values())
        return Model("roll-yaw" if whole else "bicycle", self.rover, self.spread, two_clocks=clocks)

    @cached_property
    def effects(self) -> list[Effect]:
        """The effects that runs can show with this baseline."""
        fresh = self.experiment(PlannedRun("sweep", 100.0, 2.0))
        return possible(self.model, [fresh], without=self.settled)[0]

    @cached_property
    def assumed(self) -> Assumed:
        """The noise, and the rover in which effects are looked for."""
        return assumed(list(self.driven.values()), self.model, self.effects)

    @property
    def asked(self) -> list[str]:
        """Ids of the effects that the plan is about."""
        return [e.id for e in self.effects if not self.wanted or e.id in self.wanted]

    def experiment(self, run: PlannedRun) -> Experiment:
        """The run as it was driven, or as it would be driven."""
        if run.name in self.driven:
            return self.driven[run.name]
        channels = ["delta"] if run.kind == "servo_test" else [c for c in NOISE if c != "Hz"]
        return as_experiment(run, self.rover, self.rad_per_us, channels)

    def held(self, run: PlannedRun, ay: float) -> PlannedRun:
        """The run, with an amplitude at which the simulated rover stays below this lateral acceleration.

        An oversteering rover turns more than its kinematics.
        """
        if run.kind == "servo_test":
            return run
        driven = self.experiment(run)
        found = logged(driven, self.model.structure, self.assumed.x, Sensors.of(driven))["ay"]
        share = ay / max(float(np.max(np.abs(found))), ay)
        return run if share == 1.0 else replace(run, amplitude_us=10.0 * (share * run.amplitude_us // 10.0))

    def simulate(self, runs: Sequence[PlannedRun], share: tuple[float, float]) -> None:
        """Simulates the runs that are new; share: of the whole work, before and after."""
        new = [r for r in dict.fromkeys(_single(run) for run in runs) if r not in self._evidence]
        for k, run in enumerate(new):
            self.progress(f"simulating: {run_text(run)}", share[0] + (share[1] - share[0]) * k / len(new))
            self._evidence[run] = evidence(self._basis(run), self.assumed)

    def _basis(self, run: PlannedRun) -> Basis:
        return basis(self.experiment(run), self.assumed)

    def together(self, runs: Sequence[PlannedRun], sizes: Mapping[str, float] | None = None) -> RunSet:
        """The set of these runs, each as often as it is repeated.

        sizes: {effect: multiple of its own size}, with which the runs are simulated anew.
        """
        self.simulate(runs, (0.0, 0.0))
        given, found = self.assumed, {run: self._evidence[run] for run in map(_single, runs)}
        if sizes:
            given = given.sized(sizes)
            self._bases |= {run: self._basis(run) for run in found if run not in self._bases}
            found = {run: evidence(self._bases[run], given) for run in found}
        return RunSet.of(given, [found[_single(run)] for run in runs for _ in range(run.repeat)])

    def evaluate(self, runs: Sequence[PlannedRun]) -> SetResult:
        """What a diagnosis of these runs is expected to tell about the asked effects."""
        found = expected(self.together(runs), [NONE, *self.asked])
        return SetResult(found, {e: p for e, p in found.sure.items() if e != NONE})

    def unseen(self, runs: Sequence[PlannedRun], hidden: Sequence[str]) -> tuple[Unseen, ...]:
        """Effects that a set cannot show, with the reason. hidden: those that no size shows."""
        driven = [self.experiment(run) for run in runs if run.kind != "servo_test"]
        why = possible(self.model, driven)[1] if driven else {}
        why = dict.fromkeys(hidden, "these runs hardly excite it") | why
        if not self.wanted:
            why.setdefault(
                "speed_variation", "it shows in the measured speed, whose noise is not known before the run"
            )
        why |= self.settled
        return tuple(Unseen(e, w) for e, w in sorted(why.items()) if not self.wanted or e in self.wanted)


def _single(run: PlannedRun) -> PlannedRun:
    return replace(run, repeat=1)
