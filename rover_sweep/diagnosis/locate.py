"""Where a model and the recordings differ, in sizes of the noise floor."""

from __future__ import annotations

import numpy as np

from rover_sweep.diagnosis.experiment import RATE, Experiment
from rover_sweep.diagnosis.problem import Problem
from rover_sweep.diagnosis.result import Mismatch, Profile
from rover_sweep.identify.recording import Array

BANDS = ((0.5, 1.5), (1.5, 4.0), (4.0, 10.0), (10.0, 25.0), (25.0, 60.0))  # rad/s
PLAIN = 1.35  # residual over noise, from which a place is told
MOST = 6


def mismatches(problem: Problem, rows: Array) -> tuple[Mismatch, ...]:
    """The places, largest first: per channel the worst band, then runs and turns that differ.

    problem: without nuisances; rows (size,): measured less model.
    """
    out = []
    for channel in dict.fromkeys(r.channel for r in problem.rows):
        ratios = {b: v for b in BANDS if (v := _ratio(problem, rows, channel, b)) is not None}
        worst = max(ratios, key=lambda b: ratios[b], default=None)
        if worst is None or ratios[worst] < PLAIN:
            continue
        out.append(_by_run(problem, rows, channel, worst, ratios[worst]))
        if (turned := _by_turn(problem, rows, channel)) is not None:
            out.append(turned)
    return tuple(sorted(out, key=lambda m: -m.residual_over_noise)[:MOST])


def _ratio(
    problem: Problem, rows: Array, channel: str, band: tuple[float, float], run: int | None = None
) -> float | None:
    squares = []
    for r in problem.rows:
        if r.channel == channel and run in (None, r.run):
            inside = np.flatnonzero((2 * np.pi * r.f >= band[0]) & (2 * np.pi * r.f < band[1]))
            part = rows[r.start : r.start + r.size]
            squares += [part[inside] ** 2, part[inside + r.bins.size] ** 2]
    found = np.concatenate(squares) if squares else np.empty(0)
    return float(np.sqrt(np.mean(found))) if found.size > 8 else None


def _by_run(problem: Problem, rows: Array, channel: str, band: tuple[float, float], ratio: float) -> Mismatch:
    each = [_ratio(problem, rows, channel, band, k) or 0.0 for k in range(len(problem.runs))]
    labels = [_label(run) for run in problem.runs]
    worst = int(np.argmax(each))
    others = [v for k, v in enumerate(each) if k != worst]
    apart = bool(others) and each[worst] > 1.5 * max(others)
    condition = f"most in {labels[worst]}" if apart else "throughout"
    between = f"between {band[0]:g} and {band[1]:g} rad/s"
    sentence = f"{channel} differs {between} by {ratio:.1f} times the noise, {condition}"
    names = tuple(run.name for run in problem.runs)
    return Mismatch(channel, band, condition, ratio, sentence, Profile("run", "", names, tuple(each)))


def _label(run: Experiment) -> str:
    return f"{run.name} ({np.degrees(run.amplitude):.1f} deg at {run.mean_speed:.2f} m/s)"


def _by_turn(problem: Problem, rows: Array, channel: str) -> Mismatch | None:
    """Left and right turns apart, where their residuals clearly differ."""
    sums = np.zeros((2, 2))
    for r in problem.rows:
        if r.channel != channel:
            continue
        run = problem.runs[r.run]
        lines = np.zeros(run.t.size // 2 + 1, complex)
        part = rows[r.start : r.start + r.size]
        lines[r.bins] = part[: r.bins.size] + 1j * part[r.bins.size :]
        lines[0] = 0.0
        error = np.fft.irfft(lines, run.t.size) ** 2
        noise = r.bins.size * 4.0 / run.t.size**2
        turning = np.abs(run.steer) > 0.3 * run.amplitude
        for side, sign in enumerate((1.0, -1.0)):
            chosen = turning & (np.sign(run.steer) == sign)
            sums[side] += error[chosen].sum(), noise * chosen.sum()
    left, right = (float(np.sqrt(s[0] / s[1])) if s[1] else 0.0 for s in sums)
    if max(left, right) < PLAIN or max(left, right) < 1.3 * max(min(left, right), 1e-9):
        return None
    where, ratio = ("left turns", left) if left > right else ("right turns", right)
    sentence = (
        f"{channel} differs more in {where}: {ratio:.1f} times the noise against {min(left, right):.1f}"
    )
    profile = Profile("turn", "", ("left", "right"), (left, right))
    return Mismatch(channel, (0.5, 2 * np.pi * 0.25 * RATE / 4), where, ratio, sentence, profile)
