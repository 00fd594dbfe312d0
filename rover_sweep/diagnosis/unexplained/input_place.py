"""The place of an unknown without a law: where one unmeasured input would explain all channels at once.

At each Fourier line an input s at a place adds H s to the channels, H the model's frequency responses there.
The residual's part along H is what such an input explains, whatever its course in time. The road does the
same, so that the mean part in quiet blocks of lines is subtracted from that in loud ones.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.posterior.transfers import RunTransfers
from rover_sweep.diagnosis.problem.residuals import Problem

BLOCK = 8  # lines whose level is one number
LOUD, QUIET = 1.6, 1.2  # mean square of a block's rows from which, and up to which
LOUD_ALONE = 2.2  # the same of one channel
FEWEST = 4  # loud blocks
ALIKE = 0.93  # share of the largest explained power from which another place is an alternative
EXPLAINS = 0.5  # least share of the loud blocks' residual above the floor


@dataclass(frozen=True, eq=False)
class _Block:
    """Lines of one run. level: mean square of their rows; rows: their number; explained {place: power}.

    highest: the level of the loudest channel.
    """

    level: float
    highest: float
    rows: int
    explained: Mapping[str, float]


def input_places(problem: Problem, found: Sequence[RunTransfers], residual: Array) -> tuple[str, ...]:
    """The places at which an input explains most of a residual (size,), the best first; () for none.

    problem: without tolerances. Where they explain as much, a sensor is named before the steering, and that
    before a force.
    """
    blocks = [b for k in range(len(found)) for b in _blocks(problem, found[k], k, residual)]
    loud = [b for b in blocks if b.level >= LOUD or b.highest >= LOUD_ALONE]
    quiet = [b for b in blocks if b.level <= QUIET]
    if len(loud) < FEWEST:
        return ()
    above = sum((b.level - 1.0) * b.rows for b in loud)
    explained = {}
    for place in found[0].responses:
        usual = float(np.mean([b.explained[place] for b in quiet])) if quiet else 0.0
        explained[place] = sum(b.explained[place] - usual for b in loud)
    best = max(explained.values())
    if best < EXPLAINS * above:
        return ()
    alike = sorted((p for p in explained if explained[p] >= ALIKE * best), key=lambda p: -explained[p])
    return tuple(sorted(alike, key=lambda p: (not p.startswith("sensor"), p != "steering")))


def _blocks(problem: Problem, one: RunTransfers, run: int, residual: Array) -> list[_Block]:
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
                np.add.at(along, where, np.conj(h) * (part[0] + 1j * part[1]))
                np.add.at(size, where, np.abs(h) ** 2)
        explained[place] = np.abs(along) ** 2 / np.maximum(size, 1e-300)
    out = []
    for k in range(0, lines.size - BLOCK + 1, BLOCK):
        here = slice(k, k + BLOCK)
        total, count = np.sum(power[:, here], axis=1), np.sum(number[:, here], axis=1)
        whole = count >= 2 * BLOCK  # a channel with all lines of the block
        highest = float(np.max(total[whole] / count[whole])) if np.any(whole) else 0.0
        level = float(np.sum(total) / np.sum(count))
        power_of = {place: float(np.sum(e[here])) for place, e in explained.items()}
        out.append(_Block(level, highest, int(np.sum(count)), power_of))
    return out
