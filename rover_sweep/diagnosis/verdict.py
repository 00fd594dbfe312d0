"""The verdict of a diagnosis, its sentence, remarks on the data, and how much a finding matters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import degrees

import numpy as np
from scipy.ndimage import uniform_filter1d

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.effects import Effect
from rover_sweep.diagnosis.result import Diagnosis, Finding, HeldOut, Unknown, Verdict
from rover_sweep.diagnosis.simulation.candidates import alike_speeds
from rover_sweep.diagnosis.simulation.experiment import FINE, RATE, Experiment
from rover_sweep.diagnosis.simulation.simulator import FittedModel, motion

# What an effect does to a turn: the fitted model with and without it, in a step of steering.
#
# An effect that only releases a number of the nominal model, such as the servo's lag, is compared with that
# number's normal value.


STRAIGHT, TURNING = 4.0, 8.0  # s, before and after the turn, and of it
LONGEST = 3.0  # s of the turn that is compared
VISIBLE = (
    0.01  # smallest change that a driver sees: s later, share of the yaw rate, half the share of the path
)


@dataclass(frozen=True)
class Turn:
    """A step of steering, simulated with and without an effect.

    speed [m/s]; angle: of the step [rad]; turned: heading reached without the effect [rad]. delay: added to
    the time in which r reaches half of its final value [s]; rate: relative change of the final r; path:
    distance between both rovers at its end [m].
    """

    speed: float
    angle: float
    turned: float
    delay: float
    rate: float
    path: float

    @property
    def change(self) -> float:
        """The largest of delay [s], change of r, and half of (distance over length of the turn)."""
        return max(abs(self.delay), abs(self.rate), 0.5 * self.path / (self.speed * LONGEST))

    @property
    def visible(self) -> bool:
        """True if a driver would see the change of the turn."""
        return self.change >= VISIBLE


def turn_with(effect: str, whole: FittedModel, used: Sequence[Experiment]) -> Turn | None:
    """The turn with and without the effect, None if both are equal or it belongs to one run.

    used: the runs, for the speed and size of the turn: the largest angle that was driven.
    """
    law = next((e for e in whole.model.acting if e.id == effect), None)
    if law is None or law.in_one_run or effect == "clock_offset":  # the clock is no part of the rover
        return None
    speed = float(np.mean([run.mean_speed for run in used]))
    angle = max(float(run.amplitude) for run in used)
    step, rest = _step(used[0], speed, angle), _without(law, whole)
    turning = np.cumsum(motion(step, rest.model, rest.x)["r"]) / RATE
    # slope and wind act by the heading
    turns = [_turn(replace(step, heading=psi + turning), rest, whole) for psi in (0.0, 0.5 * np.pi)]
    return max((t for t in turns if t), key=lambda t: t.change, default=None)


def _turn(step: Experiment, rest: FittedModel, whole: FittedModel) -> Turn | None:
    """One step of steering with both models, None where it is the same."""
    without = motion(step, rest.model, rest.x)
    with_it = motion(step, whole.model, whole.x)
    if np.allclose(without["r"], with_it["r"], atol=1e-9):
        return None
    begin = round(STRAIGHT * RATE)
    r0, r1 = without["r"][begin:], with_it["r"][begin:]
    last = round(LONGEST * RATE)
    ends = [float(np.mean(r[last - round(0.5 * RATE) : last])) for r in (r0, r1)]
    if not all(np.isfinite(ends)) or abs(ends[0]) < 1e-3 or abs(ends[1]) < 1e-3:
        return None
    heading = np.cumsum(r0) / RATE
    turned = np.flatnonzero(np.abs(heading) >= np.pi / 2)
    end = min(int(turned[0]) if turned.size else last, last)
    places = [_place(m, begin, end) for m in (without, with_it)]
    return Turn(
        float(step.speed[0]),
        float(np.max(np.abs(step.steer))),
        float(abs(heading[end])),
        float(_half(r1, ends[1]) - _half(r0, ends[0])) / RATE,
        ends[1] / ends[0] - 1.0,
        float(np.hypot(*(places[1] - places[0]))),
    )


def change_in_runs(effect: str, whole: FittedModel, used: Sequence[Experiment]) -> float:
    """Largest change of r, a_y or p by the effect in the runs: rms over rms of the signal."""
    law = next((e for e in whole.model.acting if e.id == effect), None)
    if law is None:
        return 0.0
    without = _without(law, whole)
    change: dict[str, float] = {}
    size: dict[str, float] = {}
    for run in used:
        one, two = without.log(run), whole.log(run)
        for c in {"r", "ay", "p"} & one.keys():
            change[c] = change.get(c, 0.0) + float(np.sum((two[c] - one[c]) ** 2))
            size[c] = size.get(c, 0.0) + float(np.sum(one[c] ** 2))
    return max((float(np.sqrt(change[c] / max(size[c], 1e-12))) for c in change), default=0.0)


def _without(law: Effect, whole: FittedModel) -> FittedModel:
    """The model without the effect, with normal values of the numbers that it releases."""
    rest = whole.model.without(law.id)
    normal = {c.name: c.start for c in rest.free if c.name in law.releases}
    return FittedModel(rest, {**whole.x, **normal})


def _step(like: Experiment, speed: float, angle: float) -> Experiment:
    """Straight, then a step of steering, at a constant speed."""
    n = round((2 * STRAIGHT + TURNING) * RATE)
    fine = np.arange(FINE * n) / (FINE * RATE)
    turning = (fine >= STRAIGHT) & (fine < STRAIGHT + TURNING)
    commanded = np.where(turning, angle, 0.0)
    return replace(
        like,
        name="a step of steering",
        t=np.arange(n) / RATE,
        steer=commanded[::FINE],
        commanded=commanded,
        speed=np.full(n, speed),
        heading=np.zeros(n),
        measured={},
        taper=np.ones(n),
        order=0,
        driven=0.0,
    )


def _half(r: Array, end: float) -> float:
    """Samples until r reaches half of its final value, interpolated."""
    share = r / end
    k = int(np.argmax(share >= 0.5))
    if k == 0:
        return 0.0
    return k - 1 + (0.5 - share[k - 1]) / (share[k] - share[k - 1])


def _place(moved: dict[str, Array], begin: int, end: int) -> Array:
    """(x, y) [m] after the turn, from the place and heading at its begin."""
    part = slice(begin, begin + end)
    psi = np.cumsum(moved["r"][part]) / RATE
    v, across = moved["V"][part], moved["v"][part]
    x = np.sum(v * np.cos(psi) - across * np.sin(psi)) / RATE
    y = np.sum(v * np.sin(psi) + across * np.cos(psi)) / RATE
    return np.array([x, y])


def turn_sentence(turn: Turn | None) -> str:
    """The change of a turn by an effect, in plain figures; "" without a turn."""
    if turn is None:
        return ""
    changes = []
    if abs(turn.delay) >= 0.005:
        kind = "adds" if turn.delay > 0 else "removes"
        changes.append(f"{kind} {abs(turn.delay):.2f} s {'to' if turn.delay > 0 else 'from'} its start")
    if abs(turn.rate) >= 0.005:
        changes.append(f"makes it {100 * abs(turn.rate):.0f} % {'tighter' if turn.rate > 0 else 'wider'}")
    where = f"a turn at {turn.speed:.1f} m/s with the wheels at {degrees(turn.angle):.0f} deg"
    if not changes and turn.path < 0.005:
        return f"it does not change {where}"
    path = f"after {degrees(turn.turned):.0f} deg the rover is {turn.path:.2f} m off"
    return f"in {where} it {' and '.join(changes) or 'changes the path'}: {path}"


NOTABLE = 1.45  # mean square of the residual rows (noise: 1) from which something is left to explain


def verdict_of(
    findings: Sequence[Finding],
    left: Unknown | None,
    variance: float,
    stopped: bool = False,
    worse: bool = False,
) -> Verdict:
    """The verdict. left: an unexplained misfit; variance: of a residual row with all findings, 1 is noise.

    worse: a channel of a held-out run is predicted worse than without the findings.
    """
    if findings:
        return "partly explained" if left or stopped or worse or variance > NOTABLE else "explained"
    return "unexplained" if left or stopped else "none"


def sentence_of(
    findings: Sequence[Finding],
    left: Unknown | None,
    variance: float,
    stopped: bool = False,
    first: Sequence[str] = (),
    listed: bool = False,
    possible: Mapping[str, float] | None = None,
) -> str:
    """The answer in one sentence; details are in `left`. first: what to measure before naming any effect.

    listed: effects that are present and do not matter are listed in the remarks. possible: {effect:
    probability} of those too uncertain to name. The other arguments are those of `verdict_of`.
    """
    named = " and ".join(f.sentence.removesuffix(", ") for f in findings)
    rest = ""
    if stopped:
        rest = "the search was stopped before all effects were tried"
    elif left:
        rest = left.sentence.partition(";")[0]
    elif variance > NOTABLE:
        ratio = f"{variance**0.5:.1f} times the noise floor"
        rest = f"the remaining residual, which no function of the state predicts, is {ratio}"
    if named and rest:
        answer = f"{named}, explain{'s' if len(findings) == 1 else ''} a part, but {rest}"
    elif left and not stopped:
        answer = rest if "candidate" in rest else f"{rest}, and no candidate explains it"
    else:
        nothing = "nothing that matters was found" if listed else "these runs show no missing effect"
        answer = named or rest or f"{nothing}: over all frequencies, the residual is at the noise floor"
        if possible and not named and not rest:
            best = max(possible, key=lambda e: possible[e])
            sure = 100 * possible[best]
            answer = f"no effect is sure enough for a name; the most probable is {best} ({sure:.0f} %)"
    begin, *others = (*first, answer)
    return ". ".join((begin, *(words[:1].upper() + words[1:] for words in others)))


def remarks_of(
    used: Sequence[Experiment],
    findings: Sequence[Finding],
    minor: Mapping[str, str],
    possible: Mapping[str, float],
    worse: Mapping[str, Sequence[str]],
) -> tuple[str, ...]:
    """Limits of the runs, and effects that are not named.

    minor: {effect: why it does not matter}. possible: {effect: probability}, of others. worse: {held-out
    run: channels that are predicted worse with the findings}.
    """
    out = []
    speeds = [uniform_filter1d(run.speed, round(RATE), mode="nearest") for run in used]
    if not used or alike_speeds(*np.percentile(np.concatenate(speeds), (5, 95))):
        out.append("all runs have the same speed, so a lag over a distance looks like a lag in time")
    if len({round(run.amplitude, 2) for run in used}) < 2:
        out.append("all runs have the same amplitude, so saturation looks like a smaller linear gain")
    out += [f"{effect} is present and does not matter: {why}" for effect, why in minor.items()]
    out += [
        f"{effect} is possible ({100 * p:.0f} %), but not sure enough for a name"
        for effect, p in possible.items()
    ]
    out += [
        f"with the findings {', '.join(channels)} of {run} fits worse than without"
        for run, channels in worse.items()
    ]
    for finding in findings:
        failed = [h.run for h in finding.held_out if h.share_removed is not None and h.share_removed < 0]
        if failed:
            out.append(
                f"{finding.effect} is not confirmed: the model with it is worse on {', '.join(failed)}"
            )
    return tuple(out)


def refuted_words(refuted: tuple[str, float]) -> str:
    """A sentence on (an effect that held-out runs refute, its probability in the other runs)."""
    effect, sure = refuted
    return (
        f"{effect} is rejected: it fits the runs (probability {100 * sure:.0f} %) but predicts the held-out "
        "runs worse; suspect a similar effect"
    )


def why_it_does_not_matter(absent: bool, turn: Turn | None = None, change: float = 1.0) -> str:
    """Why a probable effect is listed as present, but not named; "" if it matters.

    absent: the 90 % intervals of its size include zero. turn: its change of a turn, None if it changes none.
    change: of a channel in the runs, rms over rms.
    """
    if absent:
        return "the 90 % interval of its size includes zero"
    if turn is not None and not turn.visible and change < 2 * VISIBLE:
        return "it changes no turn visibly"
    return ""


def hardly_matters(held_out: Sequence[HeldOut]) -> bool:
    """True if J_rms falls by less than 5 % on every held-out run."""
    return bool(held_out) and all(h.before.j_rms - h.after.j_rms < 0.05 * h.before.j_rms for h in held_out)


def importance_words(f: Finding) -> str:
    """A sentence with the share of the held-out residual that the effect explains, "" without such runs."""
    if not f.held_out:
        return ""
    best = max(f.held_out, key=lambda h: h.share_removed if h.share_removed is not None else -np.inf)
    share = "" if best.share_removed is None else f"{100 * min(best.share_removed, 1.0):.0f} % of "
    fall = f"J_rms, with the noise: {best.before.j_rms:.2f} without it, {best.after.j_rms:.2f} with it"
    if best.share_removed is not None and best.share_removed <= 0:
        return f"It explains nothing of the residual above the noise on {best.run} ({fall})."
    words = f"It explains {share or 'little of '}the squared residual above the noise on {best.run} ({fall})"
    return f"{words}: it hardly shows in the held-out runs." if hardly_matters(f.held_out) else f"{words}."


def turn_change(found: Diagnosis) -> tuple[float, float] | None:
    """(delay [s] up to 0.4 s, relative change) of the yaw rate by all findings, None without.

    By least squares from the simulated yaw rate of the first run, against the model without them.
    """
    overlay = next((o for o in found.overlays if o.channel == "r"), None)
    if overlay is None or not found.findings or overlay.t.size < 10:
        return None
    a, b = overlay.after - np.mean(overlay.after), overlay.before - np.mean(overlay.before)
    delays = np.linspace(-0.4, 0.4, 801)
    moved = [np.interp(overlay.t - d, overlay.t, b) for d in delays]
    gains = [float(m @ a) / max(float(m @ m), 1e-30) for m in moved]
    k = int(np.argmin([np.sum((a - g * m) ** 2) for g, m in zip(gains, moved, strict=True)]))
    return float(delays[k]), gains[k] - 1.0
