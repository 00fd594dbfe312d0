"""What an effect does to a turn: the fitted model with and without it, in a step of steering.

An effect that only releases a number of the nominal model, such as the servo's lag, is compared with that
number's normal value.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import degrees

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.effects import Effect
from rover_sweep.diagnosis.held_out.worth import FittedModel
from rover_sweep.diagnosis.simulation.experiment import FINE, RATE, Experiment
from rover_sweep.diagnosis.simulation.simulator import motion

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
    distance between both rovers at the end of the turn [m].
    """

    speed: float
    angle: float
    turned: float
    delay: float
    rate: float
    path: float

    @property
    def change(self) -> float:
        """The largest of delay [s], change of r, and half the distance over the length of the turn."""
        return max(abs(self.delay), abs(self.rate), 0.5 * self.path / (self.speed * LONGEST))

    @property
    def visible(self) -> bool:
        """True where a driver would see the change of the turn."""
        return self.change >= VISIBLE


def turn_with(effect: str, whole: FittedModel, used: Sequence[Experiment]) -> Turn | None:
    """The turn with and without the effect, None where it changes nothing in it or belongs to one run.

    used: the runs, for the speed and size of the turn: the largest angle that was driven.
    """
    law = next((e for e in whole.model.structure.effects if e.id == effect), None)
    if law is None or law.in_one_run or effect == "clock_offset":  # the clock is no part of the rover
        return None
    speed = float(np.mean([run.mean_speed for run in used]))
    angle = max(float(run.amplitude) for run in used)
    step, rest = _step(used[0], speed, angle), _without(law, whole)
    turning = np.cumsum(motion(step, rest.model.structure, rest.x)["r"]) / RATE
    # slope and wind act by the heading
    turns = [_turn(replace(step, heading=psi + turning), rest, whole) for psi in (0.0, 0.5 * np.pi)]
    return max((t for t in turns if t), key=lambda t: t.change, default=None)


def _turn(step: Experiment, rest: FittedModel, whole: FittedModel) -> Turn | None:
    """One step of steering with both models, None where it is the same."""
    without = motion(step, rest.model.structure, rest.x)
    with_it = motion(step, whole.model.structure, whole.x)
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
    """What the effect changes of r, a_y or p in the runs, the largest: rms over the rms of the signal."""
    law = next((e for e in whole.model.structure.effects if e.id == effect), None)
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
    """What an effect does to a turn, in plain figures; "" where it has no part in one."""
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
