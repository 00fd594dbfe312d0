"""Where by turn and heading, and what is steadily off: signals that the residual is regressed on."""

from __future__ import annotations

import numpy as np
from scipy.stats import chi2, norm

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.locate.place_sentences import called, times, wind
from rover_sweep.diagnosis.locate.residual_maps import (
    PLAIN,
    SURE,
    Explained,
    Signals,
    explained,
    residuals_of,
)
from rover_sweep.diagnosis.problem.residuals import MEANS, Problem
from rover_sweep.diagnosis.result import Mismatch, Profile
from rover_sweep.diagnosis.simulation.experiment import RATE, Experiment

TURNED = np.pi / 2  # rad, of headings that the runs must reach over
OCTANTS = ("N", "NW", "W", "SW", "S", "SE", "E", "NE")
BREAK = 0.1  # of a signal's size, over which its sign turns
SLOW = 1.0  # rad/s, up to which a heading shows
CHANCE = float(chi2.isf(2 * norm.sf(SURE), 2))  # drop by two signals that chance would make as rarely
UNITS = {"r": (180 / np.pi, "deg/s"), "ay": (1.0, "m/s²")}


def steady(problem: Problem, rows: Array, channel: str) -> Mismatch | None:
    """A residual that does not go away: its mean, in sizes of what a mean is known to."""
    if channel not in MEANS:
        return None
    having = [r for r in problem.rows if r.channel == channel and r.bins[0] == 0]
    off = np.array([rows[r.start] for r in having])
    ratio = float(np.sqrt(np.mean(off**2))) if off.size else 0.0
    if not off.size or ratio < max(PLAIN, SURE / np.sqrt(off.size)) or abs(np.sum(np.sign(off))) < off.size:
        return None
    factor, unit = UNITS[channel]
    mean = factor * MEANS[channel] * off
    side = "left" if off[0] > 0 else "right"
    low, high = sorted((float(np.min(np.abs(mean))), float(np.max(np.abs(mean)))))
    size = f"{high:.2g}" if low > 0.9 * high else f"{low:.2g} to {high:.2g}"
    sentence = (
        f"{called(channel)} is steadily {size} {unit} further to the {side} than simulated, "
        f"{ratio:.1f} times what the mean of a run is known to"
    )
    names = tuple(problem.runs[r.run].name for r in having)
    profile = Profile("run", "", names, tuple(float(abs(v)) for v in off))
    return Mismatch(channel, (0.0, 0.0), "steady", ratio, sentence, profile)


def by_turn(problem: Problem, rows: Array, channel: str) -> Mismatch | None:
    """Left and right turns apart, where one is left over the motion and the other one is not alike."""

    def sides(run: Experiment) -> dict[str, Array]:
        turn = _turn(run)
        y = run.measured[channel]
        return {"left": y * (turn > 0), "right": y * (turn <= 0)}

    def both(run: Experiment) -> dict[str, Array]:
        y = run.measured[channel]
        return {"rest": np.ones(y.size), "motion": y, "rate": np.gradient(y, 1 / RATE)}

    def difference(run: Experiment) -> dict[str, Array]:
        return {"difference": run.measured[channel] * np.sign(_turn(run))}

    if any("r" not in run.measured for run in problem.runs):
        return None
    found = explained(problem, rows, channel, both, difference)
    if found is None or found.drop < SURE**2 or found.ratio < PLAIN:
        return None
    apart = explained(problem, rows, channel, _constant, sides)
    if apart is None or abs(apart.amounts[0] - apart.amounts[1]) < SURE * np.hypot(*apart.errors):
        return None
    return _turned(problem, channel, found, apart)


def _turned(problem: Problem, channel: str, found: Explained, apart: Explained) -> Mismatch:
    left, right = (100 * float(v) for v in apart.amounts)
    words = ", ".join(
        f"in {side} turns {abs(v):.1f} % {'more' if v > 0 else 'less'} than simulated"
        for side, v in (("left", left), ("right", right))
    )
    sentence = f"{called(channel)} turns left otherwise than right, by {times(found.ratio)}: {words}"
    where = "left turns" if abs(left) > abs(right) else "right turns"
    profile = Profile("turn", "", ("left", "right"), (float(apart.sizes[0]), float(apart.sizes[1])))
    top = max(float(r.f[-1]) for r in problem.rows if r.channel == channel)
    return Mismatch(channel, (0.0, round(2 * np.pi * top, 1)), where, found.ratio, sentence, profile)


def _turn(run: Experiment) -> Array:
    return run.measured["r"] - run.at_rest.get("r", 0.0)


def _constant(run: Experiment) -> dict[str, Array]:
    return {"rest": np.ones(run.t.size)}


def by_heading(problem: Problem, rows: Array, channel: str) -> Mismatch | None:
    """A residual that turns with the heading, as on a slope, beside what follows the motion."""
    if not all(run.has_heading and "r" in run.measured for run in problem.runs):
        return None
    headings = np.concatenate([run.heading for run in problem.runs])
    if np.ptp(headings) < TURNED:
        return None

    def heading(run: Experiment) -> dict[str, Array]:
        return {"cos": np.cos(run.heading), "sin": np.sin(run.heading)}

    found = explained(problem, rows, channel, _of_the_motion, heading)
    if found is None or found.drop < CHANCE or found.ratio < PLAIN:
        return None
    if not _in_every_run(problem, rows, channel, heading, found):
        return None
    across = wind(float(np.arctan2(found.amounts[1], found.amounts[0])))
    sentence = (
        f"{called(channel)} differs with the heading, by {times(found.ratio)}: most to the left when the "
        f"rover heads {across}, to the right the other way"
    )
    profile = _by_octant(problem, rows, channel)
    return Mismatch(channel, (0.0, SLOW), f"heading {across}", found.ratio, sentence, profile)


def _in_every_run(problem: Problem, rows: Array, channel: str, heading: Signals, found: Explained) -> bool:
    """True where each run that turns far enough says the same; another amplitude makes another course."""
    told = []
    for k, run in enumerate(problem.runs):
        if np.ptp(run.heading) < TURNED:
            continue
        alone = explained(problem, rows, channel, _of_the_motion, heading, k)
        if alone is not None:
            off = np.abs(alone.amounts - found.amounts)
            near = 0.5 * np.hypot(*found.amounts)
            told.append(bool(np.all(off < np.maximum(near, SURE * alone.errors))))
    return len(told) > 1 and all(told)


def _of_the_motion(run: Experiment) -> dict[str, Array]:
    """What looks like the heading in a slow sweep: turning, its rate and integral, bent and broken."""
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
        "side": np.tanh(turn / BREAK),
        "way": np.tanh(rate / BREAK),
    }


def _by_octant(problem: Problem, rows: Array, channel: str) -> Profile:
    """Size of what is slow of the residual over eight headings."""
    power, noise = np.zeros(8), np.zeros(8)
    for e in residuals_of(problem, rows, channel):
        lines = np.fft.rfft(e.x)
        w = 2 * np.pi * np.arange(lines.size) * RATE / e.x.size
        x = np.fft.irfft(np.where(w <= SLOW, lines, 0.0), e.x.size)
        octant = np.round(e.run.heading / (np.pi / 4)).astype(int) % 8
        expected = (
            e.noise
            * np.count_nonzero((w <= SLOW) & (w >= e.low))
            / np.count_nonzero((w <= e.high) & (w >= e.low))
        )
        np.add.at(power, octant, x**2)
        np.add.at(noise, octant, expected)
    seen = np.flatnonzero(noise > 0.01 * noise.sum())
    return Profile(
        "heading", "", tuple(OCTANTS[k] for k in seen), tuple(map(float, np.sqrt(power[seen] / noise[seen])))
    )
