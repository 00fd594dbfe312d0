"""Simulates each run of a plan once, and predicts what a diagnosis of sets of runs finds."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np

from rover_sweep.data.geometry import Geometry, Tolerances
from rover_sweep.data.results import Progress
from rover_sweep.diagnosis.effects import Effect
from rover_sweep.diagnosis.plans.expected_posterior import (
    NOISE,
    NONE,
    Assumed,
    Basis,
    Expected,
    RunEvidence,
    RunSet,
    SimilarPair,
    assumed,
    basis,
    evidence,
    expected,
)
from rover_sweep.diagnosis.result import Unseen
from rover_sweep.diagnosis.simulation.candidates import Model, has_roll, possible
from rover_sweep.diagnosis.simulation.experiment import RATE, SLOWEST, Experiment, tapered
from rover_sweep.diagnosis.simulation.simulator import logged
from rover_sweep.manoeuvre.multisine import Multisine
from rover_sweep.manoeuvre.sweep import BiasSweep, Doublet, Sweep

# The question to a plan of runs and its answer, as frozen values.


RunKind = Literal["sweep", "doublet", "bias_sweep", "multisine", "servo_test", "other"]


@dataclass(frozen=True)
class PlannedRun:
    """A run to drive, or one that was driven.

    amplitude_us: peak steering offset [us]. speed [m/s], 0 on blocks. heading: of the drive [deg clockwise
    from north], None: any direction. bias_us: steering offset about which the run is driven [us].
    repeat: number of drives. name: of a run that was driven, else "".
    """

    kind: RunKind
    amplitude_us: float
    speed: float
    heading: float | None = None
    bias_us: float = 0.0
    repeat: int = 1
    name: str = ""


@dataclass(frozen=True)
class Limits:
    """Limits of proposed runs: lateral acceleration [m/s^2], peak steering offset [us], speeds [m/s].

    why: source of the lateral acceleration, for a sentence.
    """

    ay: float
    amplitude_us: float
    speed: tuple[float, float]
    why: str


@dataclass(frozen=True)
class DetectableSize:
    """The size of an effect's parameter from which a diagnosis is expected to name the effect.

    size: None if no size is detectable. material: the size that matters; smaller is normal tolerance.
    """

    parameter: str
    unit: str
    size: float | None
    material: float | None = None


@dataclass(frozen=True)
class Plan:
    """What a set of runs can detect and separate, and the runs to add.

    runs: the given set. detectable: {effect: size}. look_alikes: the pairs that these runs do not separate,
    largest probability first. cannot_see: effects that are not detectable at any size. proposal: the runs to
    add; settles: a sentence for each of them; proposed_look_alikes: the pairs that remain with them.
    sentences: the answer first. notes: limits that were kept.
    """

    runs: tuple[PlannedRun, ...]
    detectable: Mapping[str, DetectableSize] = field(default_factory=dict)
    look_alikes: tuple[SimilarPair, ...] = ()
    cannot_see: tuple[Unseen, ...] = ()
    proposal: tuple[PlannedRun, ...] = ()
    settles: tuple[str, ...] = ()
    proposed_look_alikes: tuple[SimilarPair, ...] = ()
    sentences: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


# Runs of a plan as experiments, their lateral acceleration, and the runs that may be proposed.


USUAL_SPEED = 2.4  # m/s, of a plan without given runs
OTHER_SPEEDS = (0.6, 1.4)  # relative to the given speed
NAMES = {
    "sweep": "sweep",
    "doublet": "doublet",
    "bias_sweep": "sweep about a bias",
    "multisine": "odd/even multisine",
    "servo_test": "servo test on blocks",
    "other": "drive",
}


def manoeuvre_for(run: PlannedRun) -> Sweep | Doublet | Multisine:
    """The manoeuvre for the applet; a sweep if it cannot drive that kind."""
    if run.kind == "doublet":
        return Doublet(run.amplitude_us)
    if run.kind == "multisine":
        return Multisine(run.amplitude_us)
    if run.kind == "bias_sweep":
        return BiasSweep(run.amplitude_us, bias=run.bias_us)
    return Sweep(run.amplitude_us)


def as_experiment(run: PlannedRun, rover: Geometry, rad_per_us: float, channels: Sequence[str]) -> Experiment:
    """The run as if driven on level ground with the kinematic yaw rate; the measured channels are zero."""
    found = manoeuvre_for(run)
    t = np.arange(int(found.duration * RATE)) / RATE
    steer = -np.asarray(found.wave(t), np.float64) * rad_per_us
    speed = np.full(t.size, max(run.speed, SLOWEST))
    turned = np.cumsum(run.speed * np.tan(steer) / rover.wheelbase) / RATE
    heading = turned - np.radians(run.heading or 0.0)
    return Experiment(
        run_text(run),
        run.kind,
        t,
        steer,
        speed,
        heading,
        dict.fromkeys(channels, np.zeros(t.size)),
        {},
        {},
        tapered(t.size),
        dict.fromkeys(channels, 100.0),  # Hz, of the motion in a log
        True,
        False,
        80.0,  # Hz, of the steering in a log
    )


def run_text(run: PlannedRun) -> str:
    """The run in words, such as "sweep of 120 us at 2.4 m/s"."""
    about = f" about {run.bias_us:+g} us" if run.bias_us else ""
    at = f" at {run.speed:g} m/s" if run.speed else ""
    heading = "" if run.heading is None else f" heading {run.heading:.0f} deg"
    often = {1: "", 2: ", twice"}.get(run.repeat, f", {run.repeat} times")
    return run.name or f"{NAMES[run.kind]} of {run.amplitude_us:g} us{about}{at}{heading}{often}"


def lateral_acceleration(run: PlannedRun, rover: Geometry, rad_per_us: float) -> float:
    """V r at the largest steering angle [m/s^2], kinematic."""
    angle = min((run.amplitude_us + abs(run.bias_us)) * rad_per_us, 1.5)
    return float(run.speed**2 * np.tan(angle) / rover.wheelbase)


def largest_amplitude(speed: float, ay: float, rover: Geometry, rad_per_us: float) -> float:
    """Steering offset [us] at which V r = ay, rounded down to a multiple of 10."""
    return 10.0 * float(np.floor(np.arctan(ay * rover.wheelbase / speed**2) / rad_per_us / 10.0))


def allowed(run: PlannedRun, rover: Geometry, rad_per_us: float, limits: Limits) -> bool:
    """True if rover and applet allow the run."""
    if run.amplitude_us + abs(run.bias_us) > limits.amplitude_us or run.amplitude_us < 20.0:
        return False
    if run.kind == "servo_test":
        return True
    low, high = limits.speed
    return low <= run.speed <= high and lateral_acceleration(run, rover, rad_per_us) <= limits.ay


def usual_run(rover: Geometry, rad_per_us: float, limits: Limits) -> PlannedRun:
    """The largest sweep at the usual speed, or at a lower speed if it would be small."""
    most, speed = largest_amplitude(USUAL_SPEED, limits.ay, rover, rad_per_us), USUAL_SPEED
    while most < 60.0 and speed > limits.speed[0] * 1.2:
        speed = round(0.8 * speed, 1)
        most = largest_amplitude(speed, limits.ay, rover, rad_per_us)
    return PlannedRun("sweep", float(max(min(most, limits.amplitude_us), 20.0)), speed)


def candidates(
    base: Sequence[PlannedRun], rover: Geometry, rad_per_us: float, limits: Limits
) -> list[PlannedRun]:
    """Different runs that may be added to a set, all within the limits."""
    kinds = [r for r in base if r.kind != "servo_test"] or [usual_run(rover, rad_per_us, limits)]
    top = max(kinds, key=lambda run: run.amplitude_us)
    a, v = top.amplitude_us, round(top.speed, 1)
    fits = [c for c in _around(a, v, rover, rad_per_us, limits) if allowed(c, rover, rad_per_us, limits)]
    back = replace(top, kind="sweep", heading=((top.heading or 0.0) + 180.0) % 360.0, bias_us=0.0, name="")
    again = [replace(run, repeat=1, name="") for run in base or kinds if run.kind in ("sweep", "doublet")]
    more = [c for c in (back, *again) if allowed(c, rover, rad_per_us, limits)]
    return list(dict.fromkeys((*fits, *more)))


def _around(a: float, v: float, rover: Geometry, rad_per_us: float, limits: Limits) -> Iterator[PlannedRun]:
    """Variations of amplitude, speed and kind around a run of amplitude a [us] at v [m/s]."""
    half = float(round(a / 2))
    yield PlannedRun("sweep", half, v)
    yield PlannedRun(
        "sweep", min(largest_amplitude(v, limits.ay, rover, rad_per_us), 10.0 * round(0.16 * a)), v
    )
    for share in OTHER_SPEEDS:
        speed = round(share * v, 1)
        most = min(largest_amplitude(speed, limits.ay, rover, rad_per_us), a)
        yield PlannedRun("sweep", most, speed)
        yield PlannedRun("doublet", most, speed)
    yield PlannedRun("doublet", a, v)
    for speed in (v, round(OTHER_SPEEDS[0] * v, 1)):
        yield PlannedRun("bias_sweep", half, speed, bias_us=half)
        yield PlannedRun("multisine", a, speed)
    yield PlannedRun("servo_test", a, 0.0)


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
        """The most complete baseline for which the vehicle file has the numbers."""
        clocks = any(run.two_clocks for run in self.driven.values())
        return Model(
            "roll-yaw" if has_roll(self.rover) else "bicycle", self.rover, self.spread, two_clocks=clocks
        )

    @cached_property
    def effects(self) -> list[Effect]:
        """The effects that runs can show with this baseline."""
        fresh = self.experiment(PlannedRun("sweep", 100.0, 2.0))
        return possible(self.model, [fresh], without=self.settled)[0]

    @cached_property
    def assumed(self) -> Assumed:
        """The assumed noise floor and rover."""
        return assumed(list(self.driven.values()), self.model, self.effects)

    @property
    def asked(self) -> list[str]:
        """Ids of the effects to plan for."""
        return [e.id for e in self.effects if not self.wanted or e.id in self.wanted]

    def experiment(self, run: PlannedRun) -> Experiment:
        """The run as it was driven, or would be driven."""
        if run.name in self.driven:
            return self.driven[run.name]
        channels = ["delta"] if run.kind == "servo_test" else [c for c in NOISE if c != "Hz"]
        return as_experiment(run, self.rover, self.rad_per_us, channels)

    def held(self, run: PlannedRun, ay: float) -> PlannedRun:
        """The run with its amplitude reduced until the simulated lateral acceleration is below `ay`.

        An oversteering rover turns more than its kinematics.
        """
        if run.kind == "servo_test":
            return run
        driven = self.experiment(run)
        found = logged(driven, self.model, self.assumed.x)["ay"]
        share = ay / max(float(np.max(np.abs(found))), ay)
        return run if share == 1.0 else replace(run, amplitude_us=10.0 * (share * run.amplitude_us // 10.0))

    def simulate(self, runs: Sequence[PlannedRun], share: tuple[float, float]) -> None:
        """Simulates the new runs; share: of all work, done before and after."""
        new = [r for r in dict.fromkeys(_single(run) for run in runs) if r not in self._evidence]
        for k, run in enumerate(new):
            self.progress(f"simulating: {run_text(run)}", share[0] + (share[1] - share[0]) * k / len(new))
            self._evidence[run] = evidence(basis(self.experiment(run), self.assumed), self.assumed)

    def together(self, runs: Sequence[PlannedRun], sizes: Mapping[str, float] | None = None) -> RunSet:
        """The set of these runs with their repetitions.

        sizes: {effect: multiple of its own size}; the runs are then simulated again.
        """
        self.simulate(runs, (0.0, 0.0))
        given, found = self.assumed, {run: self._evidence[run] for run in map(_single, runs)}
        if sizes:
            given = given.sized(sizes)
            new = [run for run in found if run not in self._bases]
            self._bases |= {run: basis(self.experiment(run), given) for run in new}
            found = {run: evidence(self._bases[run], given) for run in found}
        return RunSet.of(given, [found[_single(run)] for run in runs for _ in range(run.repeat)])

    def evaluate(self, runs: Sequence[PlannedRun]) -> Expected:
        """Expected result of a diagnosis of these runs for the asked effects, each at its size."""
        return expected(self.together(runs), [NONE, *self.asked])

    def unseen(self, runs: Sequence[PlannedRun], hidden: Sequence[str]) -> tuple[Unseen, ...]:
        """Effects that a set of runs cannot show, and why. hidden: those that no size shows."""
        driven = [self.experiment(run) for run in runs if run.kind != "servo_test"]
        why = possible(self.model, driven)[1] if driven else {}
        why = dict.fromkeys(hidden, "these runs hardly excite it") | why
        if not self.wanted:
            why.setdefault(
                "speed_variation", "it shows in the measured speed; its noise is not known before the run"
            )
        why |= self.settled
        return tuple(Unseen(e, w) for e, w in sorted(why.items()) if not self.wanted or e in self.wanted)


def _single(run: PlannedRun) -> PlannedRun:
    return replace(run, repeat=1)
