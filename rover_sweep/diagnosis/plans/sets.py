"""Runs of a plan, each simulated once, and what sets of them can detect and separate."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations

from rover_sweep.data.geometry import Geometry
from rover_sweep.data.tolerances import Tolerances
from rover_sweep.diagnosis.effects import Effect
from rover_sweep.diagnosis.plans.detectable_sizes import detectable
from rover_sweep.diagnosis.plans.evidence import NOISE, Evidence, evidence
from rover_sweep.diagnosis.plans.joint_problem import Assumed, assumed, expected
from rover_sweep.diagnosis.plans.plan_result import DetectableSize, PlannedRun, SimilarPair
from rover_sweep.diagnosis.plans.proposals import as_experiment, run_text
from rover_sweep.diagnosis.plans.set_result import LATE, Stacked
from rover_sweep.diagnosis.result import Unseen
from rover_sweep.diagnosis.simulation.candidates import Model, possible
from rover_sweep.diagnosis.simulation.experiment import Experiment

Progress = Callable[[str, float], None]


@dataclass(frozen=True, eq=False)
class SetResult:
    """What a set of runs can detect and separate.

    look_alikes: pairs that are not separated. separation: {pair: how clearly it is separated}, 1 or more is
    separated. undetectable: effects that no size shows. late: {effect: detectable size over the size that
    matters}, where that is large. near: sum over the open points of how nearly each is settled, 0 to 1.
    noise_unknown: the set has neither a repeat nor a periodic wave, which separate noise from distortion.
    """

    stacked: Stacked
    look_alikes: tuple[SimilarPair, ...]
    separation: Mapping[tuple[str, str], float]
    undetectable: frozenset[str]
    late: Mapping[str, float]
    near: float
    noise_unknown: bool

    @property
    def open(self) -> int:
        """Number of points that are not settled."""
        return len(self.look_alikes) + len(self.undetectable) + len(self.late) + self.noise_unknown

    @property
    def rank(self) -> tuple[int, float]:
        """Sorts sets with fewer open points first, then those nearest to settling them."""
        return self.open, -self.near


@dataclass(eq=False)
class Planner:
    """Simulates each run once, and judges sets of them.

    wanted: effects that must be separated from all others, empty for all. driven: {run name: recorded run}.
    settled: {effect: why it is not looked for}.
    """

    rover: Geometry
    rad_per_us: float
    wanted: Sequence[str]
    spread: Tolerances
    driven: Mapping[str, Experiment]
    progress: Progress
    settled: Mapping[str, str] = field(default_factory=dict)
    _evidence: dict[PlannedRun, Evidence] = field(default_factory=dict)
    _alone: dict[PlannedRun, Stacked] = field(default_factory=dict)

    @cached_property
    def model(self) -> Model:
        """The baseline with the most physics that the vehicle file has the numbers for."""
        whole = bool(self.rover.sprung_mass and self.rover.h and self.rover.roll_inertia)
        clocks = any(run.two_clocks for run in self.driven.values())
        return Model("roll-yaw" if whole else "bicycle", self.rover, self.spread, two_clocks=clocks)

    @cached_property
    def assumed(self) -> Assumed:
        """The noise, and the rover in which effects are looked for."""
        return assumed(list(self.driven.values()), self.model)

    @cached_property
    def effects(self) -> list[Effect]:
        """The effects that runs can show with this baseline."""
        fresh = as_experiment(PlannedRun("sweep", 100.0, 2.0), self.rover, self.rad_per_us, list(NOISE))
        return possible(self.model, [fresh], without=self.settled)[0]

    @property
    def asked(self) -> list[str]:
        """Ids of the effects that the plan is about."""
        return [e.id for e in self.effects if not self.wanted or e.id in self.wanted]

    def experiment(self, run: PlannedRun) -> Experiment:
        """The run as it was driven, or as it would be driven."""
        if run.name in self.driven:
            return self.driven[run.name]
        channels = ["delta"] if run.kind == "servo_test" else list(NOISE)
        return as_experiment(run, self.rover, self.rad_per_us, channels)

    def simulate(self, runs: Sequence[PlannedRun], share: tuple[float, float]) -> None:
        """Simulates the runs that are new; share: of the whole work, before and after."""
        new = [r for r in dict.fromkeys(_single(run) for run in runs) if r not in self._evidence]
        for k, run in enumerate(new):
            self.progress(f"simulating a {run_text(run)}", share[0] + (share[1] - share[0]) * k / len(new))
            self._evidence[run] = evidence(
                self.experiment(run), self.model, self.effects, floor=self.assumed.floor
            )

    def stacked(self, runs: Sequence[PlannedRun]) -> Stacked:
        """The runs stacked, each as often as it is repeated."""
        found = [self._evidence[_single(run)] for run in runs for _ in range(run.repeat)]
        return Stacked.of(self.model, found)

    def evaluate(self, runs: Sequence[PlannedRun]) -> SetResult:
        """What a set can detect and separate of the wanted effects."""
        stacked = self.stacked(runs)
        parts = self.parts(runs)
        shown = set(stacked.sizes)
        pairs, near, separation = [], 0.0, {}
        for one, two in combinations(sorted(shown), 2):
            if one not in self.asked and two not in self.asked:
                continue
            separation[one, two] = clear = _separation(stacked, parts, one, two)
            if clear < 1.0:
                near += clear
                pairs.append(SimilarPair(one, two, max(stacked.cosine(one, two), stacked.cosine(two, one))))
        pairs.sort(key=lambda pair: -pair.cosine)
        once = [_single(run) for run in runs for _ in range(run.repeat)]
        noise_unknown = len(set(once)) == len(once) and not any(run.kind == "multisine" for run in runs)
        late = {e: times for e, times in stacked.late.items() if e in self.asked}
        near += sum(LATE / times for times in late.values())
        undetectable = frozenset(set(self.asked) - shown)
        return SetResult(stacked, tuple(pairs), separation, undetectable, late, near, noise_unknown)

    def parts(self, runs: Sequence[PlannedRun]) -> list[Stacked]:
        """Each run alone, and the runs on the ground without those on blocks."""
        single = list(dict.fromkeys(_single(run) for run in runs))
        for run in single:
            if run not in self._alone:
                self._alone[run] = Stacked.of(self.model, [self._evidence[run]])
        driven = [run for run in runs if run.kind != "servo_test"]
        out = [self._alone[run] for run in single] if len(single) > 1 else []
        return [*out, self.stacked(driven)] if 0 < len(driven) < len(runs) else out

    def unseen(self, runs: Sequence[PlannedRun], result: SetResult) -> tuple[Unseen, ...]:
        """Effects that a set cannot show, with the reason."""
        driven = [self.experiment(run) for run in runs if run.kind != "servo_test"]
        why = possible(self.model, driven)[1] if driven else {}
        why = dict.fromkeys(result.undetectable, "these runs hardly excite it") | why
        if not self.wanted:
            why.setdefault(
                "speed_variation", "it shows in the measured speed, whose noise is not known before the run"
            )
        why |= self.settled
        return tuple(Unseen(e, w) for e, w in sorted(why.items()) if not self.wanted or e in self.wanted)

    def sizes(self, runs: Sequence[PlannedRun]) -> dict[str, DetectableSize]:
        """Detectable sizes of the wanted effects in a set of runs."""
        self.progress("computing detectable sizes", 0.9)
        every = [self.experiment(run) for run in runs for _ in range(run.repeat)]
        return detectable(expected(every, self.model, self.effects, self.assumed), self.asked)


def _separation(whole: Stacked, parts: Sequence[Stacked], one: str, two: str) -> float:
    """How clearly two effects are separated, by all runs or by any part of them; 1 is separated.

    An added run cannot make it worse: if the effects look alike in it, the runs before still separate them.
    """
    best = 0.0
    for part in (whole, *parts):
        best = max(best, min(part.separation(a, b, whole.sizes) for a, b in ((one, two), (two, one))))
        if best >= 1.0:
            break
    return best


def _single(run: PlannedRun) -> PlannedRun:
    return replace(run, repeat=1)
