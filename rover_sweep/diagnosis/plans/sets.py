"""Runs of a plan simulated once each, and what sets of them show."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations

from rover_sweep.data.geometry import Geometry
from rover_sweep.data.tolerances import Tolerances
from rover_sweep.diagnosis.effects import Effect
from rover_sweep.diagnosis.plans.detectable import LATE, Stacked
from rover_sweep.diagnosis.plans.evidence import NOISE, Evidence, evidence
from rover_sweep.diagnosis.plans.plan_result import Apart, DetectableSize, PlannedRun
from rover_sweep.diagnosis.plans.proposals import as_experiment, words
from rover_sweep.diagnosis.plans.sizes import detectable
from rover_sweep.diagnosis.result import Unseen
from rover_sweep.diagnosis.simulation.candidates import Model, possible
from rover_sweep.diagnosis.simulation.experiment import Experiment

Progress = Callable[[str, float], None]


@dataclass(frozen=True, eq=False)
class Seen:
    """What a set of runs shows.

    apart: pairs not told apart; sure: how surely each pair is told apart, from 1; blind: effects that no
    size shows; late: those found only far beyond the size at which they count, {effect: times}; near: how
    near what is open is to being settled, each 0 .. 1; noisy: nothing in the set tells noise from
    distortion, neither a repeat nor a periodic wave.
    """

    stacked: Stacked
    apart: tuple[Apart, ...]
    sure: Mapping[tuple[str, str], float]
    blind: frozenset[str]
    late: Mapping[str, float]
    near: float
    noisy: bool

    @property
    def open(self) -> int:
        """Points that are left to be settled."""
        return len(self.apart) + len(self.blind) + len(self.late) + self.noisy

    @property
    def rank(self) -> tuple[int, float]:
        """Fewer open points first, then those that are nearest to being settled."""
        return self.open, -self.near


@dataclass(eq=False)
class Planner:
    """Runs simulated once each, and sets of them judged.

    wanted: effects that must be told from all others, empty for all. driven: {name: run that was}. settled:
    {effect: why it is no longer looked for}.
    """

    rover: Geometry
    rad_per_us: float
    wanted: Sequence[str]
    spread: Tolerances
    driven: Mapping[str, Experiment]
    progress: Progress
    settled: Mapping[str, str] = field(default_factory=dict)
    _shown: dict[PlannedRun, Evidence] = field(default_factory=dict)
    _alone: dict[PlannedRun, Stacked] = field(default_factory=dict)

    @cached_property
    def model(self) -> Model:
        """The fullest baseline that the vehicle file is enough for."""
        whole = bool(self.rover.sprung_mass and self.rover.h and self.rover.roll_inertia)
        clocks = any(run.two_clocks for run in self.driven.values())
        return Model("roll-yaw" if whole else "bicycle", self.rover, self.spread, two_clocks=clocks)

    @cached_property
    def effects(self) -> list[Effect]:
        """The effects that runs could show beside this baseline."""
        fresh = as_experiment(PlannedRun("sweep", 100.0, 2.0), self.rover, self.rad_per_us, list(NOISE))
        return possible(self.model, [fresh], without=self.settled)[0]

    @property
    def asked(self) -> list[str]:
        """Ids of the effects that the plan is about."""
        return [e.id for e in self.effects if not self.wanted or e.id in self.wanted]

    def experiment(self, run: PlannedRun) -> Experiment:
        """The run as it was driven, or would be."""
        if run.name in self.driven:
            return self.driven[run.name]
        channels = ["delta"] if run.kind == "servo_test" else list(NOISE)
        return as_experiment(run, self.rover, self.rad_per_us, channels)

    def simulate(self, runs: Sequence[PlannedRun], share: tuple[float, float]) -> None:
        """Looks at runs that were not yet; share: of the whole work, before and after."""
        new = [r for r in dict.fromkeys(_single(run) for run in runs) if r not in self._shown]
        for k, run in enumerate(new):
            self.progress(f"simulating a {words(run)}", share[0] + (share[1] - share[0]) * k / len(new))
            self._shown[run] = evidence(self.experiment(run), self.model, self.effects)

    def stacked(self, runs: Sequence[PlannedRun], at: Mapping[str, float] | None = None) -> Stacked:
        """The runs side by side, each as often as it is repeated; at: sizes other than the plain ones."""
        found = [
            evidence(self.experiment(run), self.model, self.effects, at) if at else self._shown[_single(run)]
            for run in runs
        ]
        return Stacked.of(
            self.model, [e for e, run in zip(found, runs, strict=True) for _ in range(run.repeat)]
        )

    def seen(self, runs: Sequence[PlannedRun]) -> Seen:
        """What a set shows of what is asked."""
        stacked = self.stacked(runs)
        parts = self.parts(runs)
        shown = set(stacked.sizes)
        pairs, near, sureness = [], 0.0, {}
        for one, two in combinations(sorted(shown), 2):
            if one not in self.asked and two not in self.asked:
                continue
            sureness[one, two] = sure = _sure(stacked, parts, one, two)
            if sure < 1.0:
                near += sure
                pairs.append(Apart(one, two, max(stacked.cosine(one, two), stacked.cosine(two, one))))
        pairs.sort(key=lambda pair: -pair.cosine)
        once = [_single(run) for run in runs for _ in range(run.repeat)]
        noisy = len(set(once)) == len(once) and not any(run.kind == "multisine" for run in runs)
        late = {e: times for e, times in stacked.late.items() if e in self.asked}
        near += sum(LATE / times for times in late.values())
        return Seen(stacked, tuple(pairs), sureness, frozenset(set(self.asked) - shown), late, near, noisy)

    def parts(self, runs: Sequence[PlannedRun]) -> list[Stacked]:
        """Each run by itself, and those on the ground without those on blocks."""
        single = list(dict.fromkeys(_single(run) for run in runs))
        for run in single:
            if run not in self._alone:
                self._alone[run] = Stacked.of(self.model, [self._shown[run]])
        driven = [run for run in runs if run.kind != "servo_test"]
        out = [self._alone[run] for run in single] if len(single) > 1 else []
        return [*out, self.stacked(driven)] if 0 < len(driven) < len(runs) else out

    def unseen(self, runs: Sequence[PlannedRun], seen: Seen) -> tuple[Unseen, ...]:
        """Effects that a set cannot show, with the reason."""
        driven = [self.experiment(run) for run in runs if run.kind != "servo_test"]
        why = possible(self.model, driven)[1] if driven else {}
        why = dict.fromkeys(seen.blind, "these runs hardly excite it") | why
        if not self.wanted:
            why.setdefault(
                "speed_variation", "shows in the measured speed, whose noise is known only afterwards"
            )
        why |= self.settled
        return tuple(Unseen(e, w) for e, w in sorted(why.items()) if not self.wanted or e in self.wanted)

    def sizes(self, runs: Sequence[PlannedRun], seen: Seen) -> dict[str, DetectableSize]:
        """Detectable sizes of what is asked, looked at again at the size itself."""
        self.progress("looking at the sizes that would be found", 0.9)
        return detectable(seen.stacked, lambda at: self.stacked(runs, at), self.asked)


def _sure(whole: Stacked, parts: Sequence[Stacked], one: str, two: str) -> float:
    """How sure two effects are told apart, by all runs together or by any part of them: 1 is told apart.

    Another run takes nothing away: where it shows them alike, those before still show them apart.
    """
    best = 0.0
    for part in (whole, *parts):
        best = max(best, min(part.told_apart(a, b, whole.sizes) for a, b in ((one, two), (two, one))))
        if best >= 1.0:
            break
    return best


def _single(run: PlannedRun) -> PlannedRun:
    return replace(run, repeat=1)
