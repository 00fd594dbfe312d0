"""The final model's residual: a channel above the noise or something unnamed; place and curve."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.held_out import EXPLAINABLE, HeldOutRun
from rover_sweep.diagnosis.posterior.infer import Inference
from rover_sweep.diagnosis.posterior.model_fit import ModelFit, RunTransfers, transfers
from rover_sweep.diagnosis.posterior.unnamed import UnnamedFamily, families
from rover_sweep.diagnosis.posterior.weights import POWER
from rover_sweep.diagnosis.problem.least_squares import COARSE, WEAK, Fitted, fit, prior_information
from rover_sweep.diagnosis.problem.residuals import Problem
from rover_sweep.diagnosis.residual_maps import SIGMAS
from rover_sweep.diagnosis.result import LawCurve, LawHeldOut, Unknown
from rover_sweep.diagnosis.simulation.augmented import AugmentedModel
from rover_sweep.diagnosis.simulation.candidates import Coordinate
from rover_sweep.diagnosis.simulation.table_law import FACTORS, OVER, TableLaw, law_at, law_effect
from rover_sweep.diagnosis.verdict import NOTABLE

# The place of an unknown without a law: where one unmeasured input would explain all channels at once.
#
# At each Fourier line an input s at a place adds H s to the channels, H the model's frequency responses
# there. The residual's part along H is what such an input explains, for any course in time. The road does
# the same, so that the mean part in quiet blocks of lines is subtracted from that in loud ones.


BLOCK = 8  # lines whose level is one number


def input_places(problem: Problem, found: Sequence[RunTransfers], residual: Array) -> tuple[str, ...]:
    """The places at which an input explains most of a residual (size,), the best first; () for none.

    problem: without tolerances. Listed are inputs that explain at least half, and 93 % of the best: first
    sensors, then the steering, then forces.
    """
    blocks = [_blocks(problem, one, run, residual) for run, one in enumerate(found)]
    over, loud = (np.concatenate(parts) for parts in zip(*(b[:2] for b in blocks), strict=True))
    if np.count_nonzero(loud) < 4:
        return ()
    above = float(over[loud].sum())
    share = {}
    for place in found[0].responses:
        explained = np.concatenate([by_place[place] for _, _, by_place in blocks])
        usual = float(np.sum(explained[~loud])) / max(int(np.count_nonzero(~loud)), 1)
        share[place] = float(np.sum(explained[loud] - usual)) / above
    best = max(share.values())
    alike = sorted((p for p in share if share[p] >= max(0.93 * best, 0.5)), key=lambda p: -share[p])
    return tuple(sorted(alike, key=lambda p: (not p.startswith("sensor"), p != "steering")))


def _blocks(
    problem: Problem, one: RunTransfers, run: int, residual: Array
) -> tuple[Array, NDArray[np.bool_], dict[str, Array]]:
    """(above, loud, {place: explained}) of the m blocks of lines of one run, each (m,).

    above: power of their rows above the noise. loud: significant in one channel or in all.
    """
    rows = [r for r in problem.rows if r.run == run]
    lines = np.unique(np.concatenate([r.bins for r in rows]))
    at = [np.searchsorted(lines, r.bins) for r in rows]
    parts = [residual[r.start : r.start + r.size].reshape(2, -1) for r in rows]
    power, number = np.zeros((len(rows), lines.size)), np.zeros((len(rows), lines.size))
    for c, (where, part) in enumerate(zip(at, parts, strict=True)):
        power[c, where] = np.sum(part**2, axis=0)
        number[c, where] = 2.0
    explained = {}
    for place, responses in one.responses.items():
        along, size = np.zeros(lines.size, complex), np.zeros(lines.size)
        for r, where, part in zip(rows, at, parts, strict=True):
            if r.channel in responses:
                h = responses[r.channel][r.bins] * r.weight
                along[where] += np.conj(h) * (part[0] + 1j * part[1])
                size[where] += np.abs(h) ** 2
        explained[place] = _summed(np.abs(along) ** 2 / np.maximum(size, 1e-300))
    each, count = _summed(power), _summed(number)
    # the noise of n rows has the power n, with the variance 2 n
    over, every = each - count, count.sum(axis=0)
    loud = over.sum(axis=0) > SIGMAS * np.sqrt(2.0 * every)
    loud |= np.any((over > SIGMAS * np.sqrt(2.0 * count)) & (count == 2.0 * BLOCK), axis=0)
    return over.sum(axis=0), loud, explained


def _summed(x: Array) -> Array:
    """Sums (..., m) over the blocks of lines (..., k)."""
    whole = x.shape[-1] // BLOCK * BLOCK
    return np.asarray(x[..., :whole].reshape(*x.shape[:-1], -1, BLOCK).sum(axis=-1))


# The laws of something without a name: the families with the largest evidence, fitted in the simulation.
#
# A family is chosen in the metric of what every rover has, and fitted with the nominal coordinates under its
# own prior, whose width the evidence has set. What it leaves may hold another family, with which all are
# fitted again. The evidence of the families at one place, summed, is what that place explains; places that
# share it are alternatives. Runs that are held out judge the laws and choose nothing.


MOST = 3  # laws
LEAST = 5.0  # ln of the evidence from which there is a law
SHARE = 0.15  # probability from which another place is an alternative
REMOVED = 0.2  # least share of the held-out residual above the floor that the laws remove
SPREAD = 2.5  # standard deviations within which they are fitted
SHARES = (1.0, 0.3, 0.1, 0.0)  # of the linear prediction; a law acts on what drives it, so it may be far off
RESONATOR = {"size": 0.2, "damping": 0.7}  # standard deviations of ln frequency, half a step, and ln damping


@dataclass(frozen=True, eq=False)
class FoundLaw:
    """A law that was fitted. alternatives: other places that explain nearly as much.

    law: with y = 0; `law_at` adds its coordinates (name, root). gain: drop of the cost by it.
    """

    law: TableLaw
    alternatives: tuple[str, ...]
    gain: float
    name: str
    root: Array

    def at(self, x: Mapping[str, float]) -> TableLaw:
        """The law at the coordinates x of the model."""
        return law_at(self.law, self.name, self.root, x)


@dataclass(frozen=True, eq=False)
class FoundLaws:
    """All laws, the most probable one first. fitted: the model with them, on the rows of the used runs."""

    laws: tuple[FoundLaw, ...]
    fitted: Fitted
    held_out: tuple[LawHeldOut, ...] = ()

    @property
    def share_removed(self) -> float | None:
        """Share of the held-out residual above the floor that they remove; None if no run can tell."""
        judged = [h for h in self.held_out if h.share_left is not None]
        before, after = (
            sum(v - 1.0 for v in vs) for vs in ([h.before for h in judged], [h.after for h in judged])
        )
        return 1.0 - after / before if judged else None

    @property
    def holds(self) -> bool:
        """True if they remove enough of the held-out residual and make no run worse."""
        share = self.share_removed
        worse = any(h.after > max(h.before, EXPLAINABLE) for h in self.held_out)
        return not worse and (share is None or share >= REMOVED)


def find_laws(
    last: ModelFit, held_out: Mapping[str, Problem], known: Sequence[UnnamedFamily] = ()
) -> FoundLaws | None:
    """The families that explain a model's residual, None if none has evidence.

    held_out: {run: its problem}. known: the families of that residual, if already computed.
    """
    metric, plain = last.problem, last.problem.plain
    base = last.closest
    variance = COARSE * last.fitted.overdispersion
    every = known or families(metric, last.fitted)
    fitted, found = base, list[FoundLaw]()
    while len(found) < MOST:
        best = max(every, key=lambda f: f.evidence(variance))
        if best.evidence(variance) < LEAST:
            break
        law, after = _with(plain, fitted, best, f"law{len(found) + 1}", base.overdispersion)
        found.append(replace(law, alternatives=_places(every, variance, best)))
        fitted = after
        if len(found) < MOST:
            left = replace(fitted, rows=metric.of(fitted.rows), jacobian=metric.of(fitted.jacobian))
            every = [f for f in families(metric, left) if f.law.kind not in {one.law.kind for one in found}]
    if not found:
        return None
    fitted = fit(plain, fitted.model, fitted.x, fitted.free, known=fitted)
    return FoundLaws(tuple(found), fitted, tuple(_judged(n, p, base, fitted) for n, p in held_out.items()))


def _with(
    problem: Problem, base: Fitted, best: UnnamedFamily, name: str, variance: float
) -> tuple[FoundLaw, Fitted]:
    """A family fitted with all that a model has: (the law, the model with its own Jacobian)."""
    _, amounts, root = best.at_best(variance)
    start = np.linalg.lstsq(root, amounts)[0]
    free = [Coordinate(f"{name}.z{k}", 0.0, -np.inf, np.inf, 1.0, np.sqrt(COARSE)) for k in range(start.size)]
    if best.law.memory == "resonance":
        free += [Coordinate(f"{name}.{n}", 0.0, -SPREAD * s, SPREAD * s, s, s) for n, s in RESONATOR.items()]
    effect = law_effect(best.law, base.model.rover, name, root)
    model = replace(base.model, unnamed=(*base.model.unnamed, effect))
    for share in SHARES:
        x = {**base.x, **{c.name: share * float(z) for c, z in zip(free, start, strict=False)}}
        rows = problem.residual(model, x)
        if rows @ rows < base.cost:
            break
    found = fit(problem, model, x, (*base.free, *free), known=base, roughly=True)
    return FoundLaw(best.law, (), base.cost - found.cost, name, root), found


def _places(every: Sequence[UnnamedFamily], variance: float, best: UnnamedFamily) -> tuple[str, ...]:
    """The other places with a share of the probability, the most probable one first."""
    logs = np.array([POWER * f.evidence(variance) for f in every])
    weights = np.exp(logs - logs.max())
    share: dict[str, float] = {}
    for f, w in zip(every, weights / weights.sum(), strict=True):
        share[f.law.place] = share.get(f.law.place, 0.0) + float(w)
    others = [p for p in share if p != best.law.place and share[p] >= SHARE]
    return tuple(sorted(others, key=lambda p: -share[p]))


def _judged(name: str, held: Problem, base: Fitted, best: Fitted) -> LawHeldOut:
    before, after = (float(np.mean(held.residual(f.model, f.x) ** 2)) for f in (base, best))
    share = (after - 1.0) / (before - 1.0) if before > EXPLAINABLE else None
    return LawHeldOut(name, before, after, share)


def drawn_laws(found: FoundLaws, one: FoundLaw, number: int, seed: int) -> list[TableLaw]:
    """The law with coordinates drawn from the posterior, with noise as large as the final residual."""
    fitted = found.fitted
    normal = fitted.jacobian.T @ fitted.jacobian / fitted.overdispersion
    covariance = np.linalg.inv(normal + np.diag(prior_information(fitted.free, absent=WEAK)))
    own = [k for k, c in enumerate(fitted.free) if c.name.startswith(f"{one.name}.")]
    random = np.random.default_rng(seed)
    root = np.linalg.cholesky(covariance[np.ix_(own, own)])
    moves = random.standard_normal((number, len(own))) @ root.T
    names, scales = [fitted.free[k].name for k in own], [fitted.free[k].scale for k in own]
    at = [fitted.x[n] for n in names]
    return [one.at(dict(zip(names, at + scales * move, strict=True))) for move in moves]


# What a law without a name could be, and the run that would tell more, in words.


_OVER = {
    "t": "something that changes while driving: tyres that warm up, a battery that sags, a load that moves",
    "v": "something that changes with speed",
    "psi": "the ground or the wind, which do not turn with the rover",
}
_COULD_BE = {
    ("steering", "delta"): "a steering linkage that is not linear",
    ("steering", "delta_dot"): "friction in the servo or the linkage",
    ("side force front", "delta"): "a steering linkage that is not linear",
    ("side force front", "a_y"): "front tyres that saturate, or steering that gives way under load",
    ("side force front", "beta"): "front tyres that saturate",
    ("side force front", "phi"): "roll steer of the front axle",
    ("side force rear", "a_y"): "rear tyres that saturate, or a rear axle that gives way under load",
    ("side force rear", "beta"): "rear tyres that saturate",
    ("side force rear", "phi"): "roll steer of the rear axle",
    ("side force", "phi"): "roll steer of both axles",
    ("yaw moment", "r"): "a locked differential or another yaw damping",
    ("yaw moment", "delta"): "wheel torques that differ between left and right, or tyre scrub in turns",
    ("yaw moment", "a_y"): "tyres that saturate differently at front and rear",
    ("roll moment", "p"): "friction or a nonlinear damper in the suspension",
    ("roll moment", "phi"): "a nonlinear spring or a stop in the suspension",
}
_NEXT = {
    "steering": "measure the road-wheel angle over the PWM at standstill, upwards and downwards",
    "side force": "drive steady turns to both sides at three speeds, each with three steering angles",
    "yaw moment": "drive steady turns to both sides at three speeds, then again while coasting",
    "roll moment": "tilt the body at standstill, release it and log its decay",
    "sensor": "turn or tilt the rover by hand through known angles and compare the sensor with them",
    "speed": "coast straight ahead, then in a turn, from the same speed",
}
_NEXT_OVER = {
    "t": "repeat the first run at the end of the session, without a pause and after one",
    "v": "drive the same steering angles at three speeds",
    "psi": "drive the same run in the opposite heading",
}


def could_be(law: TableLaw) -> str:
    """A possible cause, as a noun phrase."""
    if law.memory == "play":
        return "play, stiction or friction between servo and wheels"
    if law.memory == "resonance":
        if law.place == "steering":
            return "an elastic linkage"
        return "a swaying mast of the IMU" if law.place.startswith("sensor") else "a swinging load"
    if law.memory == "lag":
        parts = {"steering": "servo or linkage", "roll moment": "suspension"}
        sensor = law.place.startswith("sensor")
        what = "sensor or its filter" if sensor else parts.get(law.place, "tyre force")
        return f"a {what} that lags by about {law.size:g} s"
    if law.place.startswith("sensor"):
        if law.over == "signal":
            return "a wrong scale of the sensor"
        if law.over in ("signal_dot", "r_dot", "p_dot"):
            return "a lag of the sensor, or another position of it"
        return _OVER.get(law.over, "a sensor that is tilted or measures another motion too")
    return _COULD_BE.get((law.place, law.over)) or _OVER.get(law.over) or f"a missing {law.place}"


def next_run(law: TableLaw) -> str:
    """The run or measurement that would tell more."""
    place = "sensor" if law.place.startswith("sensor") else law.place
    place = "side force" if place.startswith("side force") else place
    return _NEXT_OVER.get(law.over) or _NEXT[place]


def place_words(place: str) -> str:
    """The place as part of a sentence: "the yaw moment", "the sensor of a_y"."""
    return "the " + place.replace("sensor of ay", "sensor of a_y").replace("sensor of vy", "sensor of V_y")


def over_words(law: TableLaw) -> str:
    """What the law depends on: "r", "the time in the run, times a_y"."""
    what = OVER[law.over][1]
    if law.memory == "lag":
        what = f"the change of {what} in {law.size:g} s"
    elif law.memory == "play":
        what = f"{what} behind a play"
    return f"{what}, times {FACTORS[law.times][1]}" if law.times else what


def short(law: TableLaw) -> str:
    """Place and quantity: "roll moment ~ phi", "roll moment ~ resonance of a_y at 1.4 Hz"."""
    if law.memory == "resonance":
        return f"{law.place} ~ resonance of {law.over} at {law.size:.2g} Hz"
    return f"{law.place} ~ {law.over}"


def laws_sentence(
    laws: Sequence[TableLaw], alternatives: tuple[str, ...], share: float | None, holds: bool
) -> str:
    """The laws of an unknown in a sentence.

    alternatives: places of the first. share: of the held-out residual that they remove, None without such
    runs. holds: they are in the model.
    """
    first, *others = laws
    words = f"{_acts(first, (first.place, *alternatives))}"
    words += "".join(f"; {_acts(law, (law.place,))}" for law in others)
    them, are = ("them", "they are") if others else ("it", "it is")
    goes = f"of the held-out residual disappears with {them}"
    if not holds:
        return f"{words}; too little {goes}, so {are} not in the model"
    removed = f"; {100 * min(share, 1.0):.0f} % {goes}" if share else ""
    it = "the first" if others else "it"
    return f"{words}{removed}; {it} could be {could_be(first)}; to confirm it, {next_run(first)}"


def _acts(law: TableLaw, places: tuple[str, ...]) -> str:
    at = " or ".join(place_words(p) for p in places)
    if law.memory == "resonance":
        number = f"{law.size:.2g} Hz (damping ratio {law.damping:.2g})"
        return f"a resonance at {number}, driven by {over_words(law)}, acts on {at}"
    return f"a law over {over_words(law)} acts on {at}"


DRAWN = 200  # laws for a band
GAINS = (0.3, 20.0)  # Hz, of a resonator's curve
NO_LAW = "no law over one quantity of the motion, and no resonance, explains it"
CHANNELS = {
    "r": "the yaw rate",
    "ay": "the lateral acceleration",
    "p": "the roll rate",
    "vy": "the lateral velocity",
}


def left_unexplained(found: Inference, named: bool) -> Unknown | None:
    """The misfit of the final model, None if it is at the noise floor and nothing unnamed is probable.

    named: effects were found.
    """
    misfit = found.last.misfit
    channel = max(misfit, key=lambda c: misfit[c])
    probable = found.posterior.something_else > 0.5
    if misfit[channel] <= NOTABLE and not probable:
        return None
    ratio = float(np.sqrt(misfit[channel]))
    still = "still " if named else ""
    sentence = f"{CHANNELS[channel]} {still}differs from the simulation by {ratio:.2g} times the noise"
    if misfit[channel] <= NOTABLE:
        sure = 100 * found.posterior.something_else
        sentence = f"an effect that is not in the list is missing ({sure:.0f} %)"
    return Unknown(channel, "nothing that was tried", ratio, f"{sentence}; no candidate explains it")


def with_laws_of(
    left: Unknown, last: ModelFit, held_out: Sequence[HeldOutRun], known: Sequence[UnnamedFamily] = ()
) -> tuple[Unknown, FoundLaws | None]:
    """(the unknown with its place and curves, the laws); its sentence says if none holds.

    last: the model of the answer. held_out: runs that judge the laws. known: see `find_laws`.
    """
    if left.channel == "V":
        return replace(left, place="speed"), None
    found = find_laws(last, {h.run.name: h.problem for h in held_out}, known)
    if found is None:  # the place where one unmeasured input explains most
        plain, near = last.problem.plain, last.closest
        likely = input_places(plain, transfers(plain.runs, near.model, near.x), near.rows)
        at = " or ".join(place_words(p) for p in likely)
        words = f"{left.sentence}; {f'it has the pattern of an unmeasured input at {at}' if at else NO_LAW}"
        return replace(left, sentence=words, place="".join(likely[:1]), alternatives=likely[1:]), None
    laws, first = [one.at(found.fitted.x) for one in found.laws], found.laws[0]
    holds = found.holds
    words = laws_sentence(laws, first.alternatives, found.share_removed, holds)
    return (
        replace(
            left,
            sentence=f"{left.sentence}; {words}",
            depends_on=", ".join(dict.fromkeys(over_words(law) for law in laws)),
            law="; ".join(map(short, laws)) if holds else "",
            law_gain=found.share_removed if holds else None,
            place=first.law.place,
            alternatives=first.alternatives,
            curves=tuple(_curve(found, one) for one in found.laws) if holds else (),
            held_out=found.held_out,
            could_be=could_be(laws[0]),
            next_run=next_run(laws[0]),
        ),
        found if holds else None,
    )


def in_model(model: AugmentedModel, found: FoundLaws) -> AugmentedModel:
    """The model with the laws; its coordinates as refitted with them."""
    x = {name: value for name, value in found.fitted.x.items() if not name.startswith("law")}
    return replace(model, x=x, laws=tuple(one.at(found.fitted.x) for one in found.laws))


def _curve(found: FoundLaws, one: FoundLaw) -> LawCurve:
    """The law with its 90 % band, or a resonator's gain."""
    law = one.at(found.fitted.x)
    resonates = law.memory == "resonance"
    x = np.array(law.x)
    if resonates:
        x = np.sort(np.concatenate((np.geomspace(*GAINS, 40), law.size * np.linspace(0.7, 1.4, 21))))
    shown = _gain if resonates else _table
    drawn = [shown(some, x) for some in drawn_laws(found, one, DRAWN, seed=1)]
    low, high = np.quantile(drawn, (0.05, 0.95), axis=0)
    return LawCurve(
        place=law.place,
        alternatives=one.alternatives,
        over=law.over,
        over_unit="Hz" if resonates else law.over_unit,
        unit=f"{law.unit} per {law.over_unit}" if resonates else law.unit,
        x=tuple(x.tolist()),
        y=tuple(shown(law, x).tolist()),
        low=tuple(low.tolist()),
        high=tuple(high.tolist()),
        gain=one.gain,
        times=law.times,
        memory=law.memory,
        size=law.size,
        damping=law.damping,
    )


def _table(law: TableLaw, x: Array) -> Array:
    """The points (n,) relative to the value at x = 0, or to the mean where the range does not hold 0: a
    constant is not separable from trim, biases and stiffness."""
    y = np.array(law.y)
    return np.asarray(y - (law.at(np.zeros(1))[0] if x[0] < 0.0 < x[-1] else y.mean()))


def _gain(law: TableLaw, f: Array) -> Array:
    """Magnitude (n,) of the resonator's response at f (n,) [Hz]."""
    s = 1j * f / law.size
    return np.asarray(np.abs((law.y[0] + law.y[1] * s) / (1.0 + 2.0 * law.damping * s + s * s)))
