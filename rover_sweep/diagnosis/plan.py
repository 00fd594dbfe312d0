"""Before driving: what a set of runs would show of each effect, and which effects would look alike.

No data is needed: the runs are simulated with the vehicle file's numbers and the noise of a small rover,
and the signatures of the effects are compared after refitting the nominal model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rover_sweep.diagnosis.candidates import Model, possible
from rover_sweep.diagnosis.experiment import RATE, Experiment
from rover_sweep.diagnosis.fitting import Fitted, fit, sensitivities
from rover_sweep.diagnosis.floor import Floor
from rover_sweep.diagnosis.nominal import Spread
from rover_sweep.diagnosis.plan_types import Apart, DetectableSize, Plan, PlannedRun
from rover_sweep.diagnosis.problem import with_floors
from rover_sweep.diagnosis.result import Unseen
from rover_sweep.diagnosis.search import tangent
from rover_sweep.diagnosis.signatures import Signature, columns, signatures
from rover_sweep.diagnosis.simulate import Sensors, Structure, logged
from rover_sweep.diagnosis.threshold import null
from rover_sweep.identify.effects import library
from rover_sweep.identify.geometry import Geometry
from rover_sweep.identify.multisine import Multisine
from rover_sweep.identify.recording import Array
from rover_sweep.identify.sweep import BiasSweep, Doublet, Sweep

ALIKE = 0.9  # cosine, from which two effects are not told apart
CLEAR = 0.02  # of gained pairs and effects, below which a further run is not worth its drive
NOISE = {"r": 3e-5, "ay": 1.8e-3, "p": 6e-5, "vy": 1e-5}
"""One-sided densities, unit^2/Hz: those of the official firmware's recordings of a 2.7 kg rover."""
FIRST = (PlannedRun("sweep", 120.0, 2.4), PlannedRun("sweep", 240.0, 2.4))
MOST_RUNS = 3


@dataclass(frozen=True, eq=False)
class Seen:
    """What a set of runs shows: sizes per effect, pairs that look alike, effects that no size shows."""

    detectable: dict[str, DetectableSize]
    apart: tuple[Apart, ...]
    cannot_see: tuple[Unseen, ...]

    @property
    def open(self) -> int:
        """What is left to be settled."""
        return len(self.apart) + 2 * len(self.cannot_see)


def plan(runs: Sequence[PlannedRun], rover: Geometry, rad_per_us: float, wanted: Sequence[str] = ()) -> Plan:
    """What these runs tell of all effects, or of the wanted ones, and the fewest runs found that tell more.

    rad_per_us: road-wheel angle per us of servo output, positive.
    """
    now = tuple(runs)
    base = now or FIRST
    seen = _seen(base, rover, rad_per_us, wanted)
    proposal: tuple[PlannedRun, ...] = () if now else FIRST
    best = seen
    while best.open and len(proposal) < MOST_RUNS + (0 if now else len(FIRST)):
        trials = [
            (c, _seen((*base, *_added(proposal, now), c), rover, rad_per_us, wanted))
            for c in _candidates(base)
        ]
        choice, result = min(trials, key=lambda t: t[1].open)
        if result.open >= best.open:
            break
        proposal, best = (*proposal, choice), result
    shown = seen if now else best
    return Plan(
        now, shown.detectable, shown.apart, shown.cannot_see, proposal, best.apart,
        _sentences(now, shown, proposal, best),
    )  # fmt: skip


def _added(proposal: tuple[PlannedRun, ...], now: tuple[PlannedRun, ...]) -> tuple[PlannedRun, ...]:
    return proposal if now else proposal[len(FIRST) :]


def _sentences(
    now: tuple[PlannedRun, ...], seen: Seen, proposal: tuple[PlannedRun, ...], best: Seen
) -> tuple[str, ...]:
    told = len(seen.detectable) - len({e for a in seen.apart for e in (a.first, a.second)})
    first = f"{told} of {len(seen.detectable) + len(seen.cannot_see)} effects would be told apart"
    if proposal and now:
        gain = seen.open - best.open
        return (first, f"{len(proposal)} more run(s) would settle {gain} of {seen.open} open points")
    return (
        first,
        *(["a servo test on blocks settles what stays alike in the steering"] if seen.apart else []),
    )


def _candidates(base: Sequence[PlannedRun]) -> list[PlannedRun]:
    """Runs that may be added: half and double amplitude, another speed, the way back, a bias."""
    top = max(base, key=lambda run: run.amplitude_us)
    a, v = top.amplitude_us, top.speed
    return [
        PlannedRun("sweep", round(a / 2), v),
        PlannedRun("sweep", a, round(0.6 * v, 2)),
        PlannedRun("sweep", a, v, heading=((top.heading or 0.0) + 180.0) % 360.0),
        PlannedRun("doublet", a, v),
    ]


def _seen(runs: Sequence[PlannedRun], rover: Geometry, rad_per_us: float, wanted: Sequence[str]) -> Seen:
    driven = [_experiment(run, rad_per_us, k) for k, run in enumerate(runs) if run.kind != "servo_test"]
    whole = bool(rover.sprung_mass and rover.h and rover.roll_inertia)
    model = Model("roll-yaw" if whole else "bicycle", rover, Spread())
    x = {c.name: c.start for c in model.free}
    driven = [_measured(run, model.structure, x) for run in driven]
    f = np.array([0.01, 100.0])
    floor = Floor(f, {c: np.full(2, d) for c, d in NOISE.items()})
    problem = with_floors(driven, [floor] * len(driven))
    effects, unseen = possible(model, driven, wanted)
    fitted = sensitivities(problem, fit(problem, model.structure, model.free, x, steps=1))
    tiny = signatures(problem, fitted, model, effects, tiny=True)
    metric = problem.in_metric(columns(tiny, problem.size))
    fitted = sensitivities(metric, fit(metric, model.structure, model.free, x, steps=1))
    found = signatures(metric, fitted, model, effects)
    tang = tangent(fitted)
    limits = null(found, signatures(metric, fitted, model, effects, tiny=True), tang, 1.0, 1).thresholds
    outside = {k: tang.outside(s.rows) for k, s in enumerate(found)}
    sizes, blind = _sizes(found, outside, limits, fitted)
    hidden = {e: why for e, why in unseen.items() if not wanted or e in wanted} | blind
    alike = _alike(found, outside, list(sizes))
    return Seen(sizes, alike, tuple(Unseen(e, why) for e, why in hidden.items()))


def _sizes(
    found: Sequence[Signature], outside: dict[int, Array], limits: dict[str, float] | object, fitted: Fitted
) -> tuple[dict[str, DetectableSize], dict[str, str]]:
    sizes: dict[str, DetectableSize] = {}
    blind: dict[str, str] = {}
    bounded = {c.name: c for c in fitted.free}
    for k, s in enumerate(found):
        effect = library()[s.effect]
        parameter = next(p for p in effect.parameters if p.name == s.parameter)
        per = effect.per.get(parameter.name, 1.0)
        strength = float(np.linalg.norm(outside[k])) / abs(s.size / per)
        read = effect.reads.get(parameter.name)
        needed = limits[s.effect] if isinstance(limits, dict) else 9.0
        size = np.sqrt(needed) / strength if strength > 1e-6 else np.inf
        if read in bounded:  # a nominal coordinate shows once it leaves its material range
            size = max(0.0, bounded[read].high / per) + 0.1 * parameter.size
        if not np.isfinite(size) or size > 20 * parameter.size:
            if s.effect not in sizes:
                blind[s.effect] = "these runs hardly excite it"
            continue
        blind.pop(s.effect, None)
        size = max(float(size), effect.material.get(parameter.name, 2.0 * parameter.tiny))
        value = parameter.value(size)
        material = effect.material.get(parameter.name)
        sizes.setdefault(
            s.effect,
            DetectableSize(
                parameter.name, parameter.unit, float(value), parameter.value(material) if material else None
            ),
        )
    return sizes, blind


def _alike(
    found: Sequence[Signature], outside: dict[int, Array], effects: Sequence[str]
) -> tuple[Apart, ...]:
    pairs: dict[tuple[str, str], float] = {}
    units = {k: v / max(float(np.linalg.norm(v)), 1e-12) for k, v in outside.items()}
    for i, one in enumerate(found):
        for j, two in enumerate(found[:i]):
            if one.effect != two.effect and one.effect in effects and two.effect in effects:
                cosine = abs(float(units[i] @ units[j]))
                key = (two.effect, one.effect)
                pairs[key] = max(pairs.get(key, 0.0), cosine)
    alike = [Apart(a, b, c) for (a, b), c in pairs.items() if c >= ALIKE]
    return tuple(sorted(alike, key=lambda a: -a.cosine))


def _experiment(run: PlannedRun, rad_per_us: float, number: int) -> Experiment:
    """A planned run as if it had been driven, still without measurements."""
    t, wave = _wave(run)
    heading = 0.0 if run.heading is None else -np.radians(run.heading)
    n = t.size
    edge = int(RATE)
    taper = np.ones(n)
    taper[:edge] = 0.5 - 0.5 * np.cos(np.pi * (np.arange(edge) + 0.5) / edge)
    taper[-edge:] = taper[:edge][::-1]
    return Experiment(
        f"run{number + 1}", run.kind, t, -wave * rad_per_us, np.full(n, run.speed), np.full(n, heading),
        {}, {}, {}, taper, dict.fromkeys(NOISE, 100.0), run.heading is not None, False, 80.0,
    )  # fmt: skip


def _wave(run: PlannedRun) -> tuple[Array, Array]:
    """(t (n,) s, steering offset (n,) us) at the simulation's rate."""
    law: Sweep | Doublet | Multisine
    if run.kind == "doublet":
        law = Doublet(run.amplitude_us)
    elif run.kind == "multisine":
        law = Multisine(run.amplitude_us)
    elif run.kind == "bias_sweep":
        law = BiasSweep(run.amplitude_us, bias=run.bias_us)
    else:
        law = Sweep(run.amplitude_us)
    t = np.arange(int(law.duration * RATE)) / RATE
    wave = np.asarray(law.wave(t), np.float64)
    return np.asarray(t, np.float64), wave


def _measured(run: Experiment, structure: Structure, x: dict[str, float]) -> Experiment:
    """The planned run with what the nominal model would show."""
    from dataclasses import replace

    wanted = replace(run, measured=dict.fromkeys(NOISE, run.t))
    return replace(wanted, measured=logged(wanted, structure, x, Sensors.of(wanted)))
