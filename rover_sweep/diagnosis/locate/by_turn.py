"""Location by turn, heading and steady error: the residual is regressed on signals of each."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.special import ndtr

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.locate.residual_maps import (
    LARGE,
    SIGMAS,
    SignalFit,
    Signals,
    channel_name,
    fit_signals,
    noise_ratio,
    residuals_of,
)
from rover_sweep.diagnosis.problem.residuals import MEANS, Problem
from rover_sweep.diagnosis.result import Mismatch, Profile
from rover_sweep.diagnosis.simulation.experiment import RATE, Experiment

WINDS = ("north", "north-west", "west", "south-west", "south", "south-east", "east", "north-east")
SLOW = 1.0  # rad/s, highest frequency in the picture over headings


def steady(problem: Problem, rows: Array, channel: str) -> Iterator[Mismatch]:
    """A mean residual with the same sign in all runs, over the accuracy of a run's mean (`MEANS`)."""
    if channel not in MEANS:
        return
    having = [r for r in problem.rows if r.channel == channel and r.bins[0] == 0]
    off = np.array([rows[r.start] for r in having])
    ratio = float(np.sqrt(np.mean(off**2))) if off.size else 0.0
    if not off.size or ratio < max(LARGE, SIGMAS / np.sqrt(off.size)) or abs(np.sum(np.sign(off))) < off.size:
        return
    factor, unit = (180 / np.pi, "deg/s") if channel == "r" else (1.0, "m/s²")
    mean = factor * MEANS[channel] * off
    side = "left" if off[0] > 0 else "right"
    low, high = sorted((float(np.min(np.abs(mean))), float(np.max(np.abs(mean)))))
    size = f"{high:.2g}" if low > 0.9 * high else f"{low:.2g} to {high:.2g}"
    sentence = (
        f"{channel_name(channel)} is steadily {size} {unit} further to the {side} than simulated, "
        f"{ratio:.1f} times the accuracy of a run's mean"
    )
    names = tuple(problem.runs[r.run].name for r in having)
    profile = Profile("run", "", names, tuple(float(abs(v)) for v in off))
    yield Mismatch(channel, (0.0, 0.0), "steady", ratio, sentence, profile)


def by_turn(problem: Problem, rows: Array, channel: str) -> Iterator[Mismatch]:
    """Left and right turns, where the residual is not the same share of the motion in both."""

    def sides(run: Experiment) -> dict[str, Array]:
        turn = _turn(run)
        y = run.measured[channel]
        return {"left": y * (turn > 0), "right": y * (turn <= 0)}

    def both(run: Experiment) -> dict[str, Array]:
        y = run.measured[channel]
        return {"rest": np.ones(y.size), "motion": y, "rate": np.gradient(y, 1 / RATE)}

    def difference(run: Experiment) -> dict[str, Array]:
        return {"difference": run.measured[channel] * np.sign(_turn(run))}

    def constant(run: Experiment) -> dict[str, Array]:
        return {"rest": np.ones(run.t.size)}

    if any("r" not in run.measured for run in problem.runs):
        return
    found = fit_signals(problem, rows, channel, both, difference)
    if found is None or found.drop < SIGMAS**2 or found.ratio < LARGE:
        return
    apart = fit_signals(problem, rows, channel, constant, sides)
    if apart is None or abs(apart.amounts[0] - apart.amounts[1]) < SIGMAS * np.hypot(*apart.errors):
        return
    left, right = (100 * float(v) for v in apart.amounts)
    words = ", ".join(
        f"{abs(v):.1f} % {'more' if v > 0 else 'less'} than simulated in {side} turns"
        for side, v in (("left", left), ("right", right))
    )
    size = noise_ratio(found.ratio)
    sentence = f"{channel_name(channel)} differs between left and right turns by {size}: {words}"
    where = "left turns" if abs(left) > abs(right) else "right turns"
    profile = Profile("turn", "", ("left", "right"), (float(apart.sizes[0]), float(apart.sizes[1])))
    top = max(float(r.f[-1]) for r in problem.rows if r.channel == channel)
    yield Mismatch(channel, (0.0, round(2 * np.pi * top, 1)), where, found.ratio, sentence, profile)


def _turn(run: Experiment) -> Array:
    return run.measured["r"] - run.at_rest.get("r", 0.0)


def by_heading(problem: Problem, rows: Array, channel: str) -> Iterator[Mismatch]:
    """A residual in proportion to the cosine and sine of the heading, as on a slope.

    Signals of the motion are fitted too, so that only the rest counts.
    """
    if not all(run.has_heading and "r" in run.measured for run in problem.runs):
        return
    if np.ptp(np.concatenate([run.heading for run in problem.runs])) < np.pi / 2:
        return

    def heading(run: Experiment) -> dict[str, Array]:
        return {"cos": np.cos(run.heading), "sin": np.sin(run.heading)}

    found = fit_signals(problem, rows, channel, _of_the_motion, heading)
    # a drop by two signals that is as rare as `SIGMAS` on both sides
    if found is None or found.drop < -2 * np.log(2 * ndtr(-SIGMAS)) or found.ratio < LARGE:
        return
    if not _in_every_run(problem, rows, channel, heading, found):
        return
    across = WINDS[int(np.round(np.arctan2(found.amounts[1], found.amounts[0]) / (np.pi / 4))) % 8]
    sentence = (
        f"{channel_name(channel)} differs with the heading by {noise_ratio(found.ratio)}: most to the left "
        f"when the rover heads {across}, and to the right in the opposite direction"
    )
    profile = _by_octant(problem, rows, channel)
    yield Mismatch(channel, (0.0, SLOW), f"heading {across}", found.ratio, sentence, profile)


def _in_every_run(problem: Problem, rows: Array, channel: str, heading: Signals, found: SignalFit) -> bool:
    """True where all runs with enough headings, at least two, agree on the amounts."""
    agree = []
    for k, run in enumerate(problem.runs):
        if np.ptp(run.heading) < np.pi / 2:
            continue
        alone = fit_signals(problem, rows, channel, _of_the_motion, heading, k)
        if alone is not None:
            off = np.abs(alone.amounts - found.amounts)
            near = 0.5 * np.hypot(*found.amounts)
            agree.append(bool(np.all(off < np.maximum(near, SIGMAS * alone.errors))))
    return len(agree) > 1 and all(agree)


def _of_the_motion(run: Experiment) -> dict[str, Array]:
    """Signals that resemble the heading in a slow sweep: yaw rate, its rate, its integral, and functions."""
    turn = _turn(run)
    rate = np.gradient(turn, 1 / RATE)
    turn, rate = (x / max(float(np.std(x)), 1e-9) for x in (turn, rate))
    return {
        "rest": np.ones(turn.size),
        "turn": turn,
        "rate": rate,
        "integral": run.heading - np.mean(run.heading),
        "turn^3": turn**3,
        "turn^2 rate": turn**2 * rate,
        "turn rate^2": turn * rate**2,
        "rate^3": rate**3,
        "abs turn": np.abs(turn),
        "abs rate": np.abs(rate),
        "side": np.tanh(10.0 * turn),
        "way": np.tanh(10.0 * rate),
    }


def _by_octant(problem: Problem, rows: Array, channel: str) -> Profile:
    """RMS over noise of the residual's slow part over eight headings."""
    power, noise = np.zeros(8), np.zeros(8)
    for e in residuals_of(problem, rows, channel):
        lines = np.fft.rfft(e.x)
        w = 2 * np.pi * np.arange(lines.size) * RATE / e.x.size
        x = np.fft.irfft(np.where(w <= SLOW, lines, 0.0), e.x.size)
        octant = np.round(e.run.heading / (np.pi / 4)).astype(int) % 8
        inside = w[(w >= e.low) & (w <= e.high)]
        np.add.at(power, octant, x**2)
        np.add.at(noise, octant, e.noise * np.mean(inside <= SLOW))
    known = np.flatnonzero(noise > 0.01 * noise.sum())
    ratio = np.sqrt(power[known] / noise[known])
    names = tuple("".join(word[0] for word in WINDS[k].split("-")).upper() for k in known)
    return Profile("heading", "", names, tuple(map(float, ratio)))
