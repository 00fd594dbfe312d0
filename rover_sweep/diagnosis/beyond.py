"""What no candidate explains: a residual that the state predicts on a run the regression did not see."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from rover_sweep.diagnosis.choose import LOUD, Round
from rover_sweep.diagnosis.experiment import RATE
from rover_sweep.diagnosis.problem import Problem
from rover_sweep.diagnosis.result import Unknown
from rover_sweep.diagnosis.simulate import Sensors, Structure, motion
from rover_sweep.identify.recording import Array

PREDICTED = 0.3  # share of the residual above the floor that the state must predict on the other runs
BLOCK = 8  # lines
WORDS = {"r": "the yaw rate", "ay": "the lateral acceleration", "p": "the roll rate"}
KEPT = 3  # terms of the sketch of a law
MEMORIES = (0.05, 0.15, 0.5)  # s, of low-passes of the state


def unknown(last: Round) -> Unknown | None:
    """The answer on what the final model leaves, None where it is at the noise floor or only noise.

    The residual of each channel is regressed on functions of the model's state, terms taken one at a
    time (a SINDy-type sketch); it counts where it predicts the last run, which the regression does not
    see. Of a single run every other block of lines is left out instead.
    """
    problem, rows = last.problem, last.fitted.rows
    best: Unknown | None = None
    loud = {c: m for c, m in last.mean_squares.items() if m > LOUD}
    for channel, mean in loud.items():
        terms = _terms(problem, last.model.structure, dict(last.fitted.x), channel)
        chosen, gain = _sketch(problem, rows, channel, terms)
        if gain < PREDICTED:
            continue
        ratio = float(np.sqrt(mean))
        if best is None or ratio > best.residual_over_noise:
            on = ", ".join(chosen)
            best = Unknown(
                channel, on, ratio,
                f"{WORDS[channel]} still differs by {ratio:.1f} times the noise; it follows {on}, "
                "and no candidate explains it",
                f"residual of {channel} ~ " + " + ".join(chosen), gain,
            )  # fmt: skip
    return best or _unpredicted(loud)


def _unpredicted(loud: dict[str, float]) -> Unknown | None:
    """Something that no function of the state tried here predicts on the run left out."""
    if not loud:
        return None
    channel = max(loud, key=lambda c: loud[c])
    ratio = float(np.sqrt(loud[channel]))
    return Unknown(
        channel, "nothing that was tried", ratio,
        f"{WORDS[channel]} still differs by {ratio:.1f} times the noise; no candidate explains it, and no "
        "simple function of the state predicts it",
    )  # fmt: skip


def _terms(problem: Problem, structure: Structure, x: dict[str, float], channel: str) -> dict[str, Array]:
    """Rows (size of the channel's,) of functions of the state, scaled to unit length."""
    columns: dict[str, list[Array]] = {}
    for k, run in enumerate(problem.runs):
        m = motion(run, structure, x)
        base = {
            "v": m["v"],
            "r": m["r"],
            "p": m["p"],
            "phi": m["phi"],
            "delta": m["delta"],
            "a_y": m["across"],
        }
        if run.has_heading:
            base |= {"sin(psi)": np.sin(m["psi"]), "cos(psi)": np.cos(m["psi"])}
        functions = dict(base)
        for name, s in base.items():
            functions[f"{name}^3"] = s**3
            functions[f"abs({name})"] = np.abs(s)
            functions[f"sgn({name})"] = np.tanh(s / (0.1 * np.std(s) + 1e-9))
            functions[f"d{name}/dt"] = np.gradient(s, 1 / RATE)
            for memory in MEMORIES:
                keep = float(np.exp(-1 / (RATE * memory)))
                functions[f"{name} of the last {memory:g} s"] = lfilter([1 - keep], [1, -keep], s)
        logs = Sensors.of(run).through(functions, structure, x)
        row = next(r for r in problem.rows if r.run == k and r.channel == channel)
        for name, y in logs.items():
            lines = np.fft.rfft(y * run.taper)[row.bins] * row.weight
            columns.setdefault(name, []).append(np.concatenate((lines.real, lines.imag)))
    return {n: np.concatenate(parts) for n, parts in columns.items()}


def _sketch(problem: Problem, rows: Array, channel: str, terms: dict[str, Array]) -> tuple[list[str], float]:
    """(terms chosen on the seen rows, share of the others' residual above the floor that they predict)."""
    target = problem.part(rows, channel=channel)
    test = _unseen([r.bins.size for r in problem.rows if r.channel == channel])
    left, chosen = target[~test], []
    fitted: Array = np.zeros(0)
    for _ in range(KEPT):
        scores = {
            n: abs(float(c[~test] @ left)) / (np.linalg.norm(c[~test]) + 1e-12) for n, c in terms.items()
        }
        best = max((n for n in scores if n not in chosen), key=lambda n: scores[n])
        chosen.append(best)
        a = np.column_stack([terms[n] for n in chosen])
        fitted = np.asarray(np.linalg.lstsq(a[~test], target[~test], rcond=None)[0], np.float64)
        left = target[~test] - a[~test] @ fitted
    a = np.column_stack([terms[n] for n in chosen])
    before, after = float(np.sum(target[test] ** 2)), float(np.sum((target[test] - a[test] @ fitted) ** 2))
    above = before - test.sum()
    return chosen, float((before - after) / above) if above > 0.1 * test.sum() else 0.0


def _unseen(lines: list[int]) -> NDArray[np.bool_]:
    """Rows left out of a regression; lines: of each run, whose real parts come before the imaginary ones."""
    if len(lines) > 1:
        return np.repeat([False] * (len(lines) - 1) + [True], [2 * n for n in lines])
    # neighbours share what the taper spreads, so whole blocks
    return np.tile(np.arange(lines[0]) // BLOCK % 2 == 1, 2)
