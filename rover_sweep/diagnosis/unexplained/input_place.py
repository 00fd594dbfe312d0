"""The place of an unknown without a law: where one unmeasured input would explain all channels at once.

At each Fourier line an input s at a place adds H s to the channels, H the model's frequency responses there.
The residual's part along H is what such an input explains, for any course in time. The road does the same, so
that the mean part in quiet blocks of lines is subtracted from that in loud ones.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.locate.residual_maps import SIGMAS
from rover_sweep.diagnosis.posterior.transfers import RunTransfers
from rover_sweep.diagnosis.problem.residuals import Problem

BLOCK = 8  # lines whose level is one number


@dataclass(frozen=True, eq=False)
class _Blocks:
    """m blocks of lines of one run: above (m,), power of their rows above the noise; explained {place: (m,)}.

    loud (m,): the power of all channels, or of one, is significantly above the noise.
    """

    above: Array
    loud: NDArray[np.bool_]
    explained: Mapping[str, Array]


def input_places(problem: Problem, found: Sequence[RunTransfers], residual: Array) -> tuple[str, ...]:
    """The places at which an input explains most of a residual (size,), the best first; () for none.

    problem: without tolerances. Where they explain as much, a sensor is named before the steering, and that
    before a force. An input explains at least half, and nearly as much as another where it has 93 % of that.
    """
    blocks = [_blocks(problem, one, run, residual) for run, one in enumerate(found)]
    loud = np.concatenate([b.loud for b in blocks])
    if np.count_nonzero(loud) < 4:
        return ()
    above = float(np.concatenate([b.above for b in blocks])[loud].sum())
    share = {}
    for place in found[0].responses:
        explained = np.concatenate([b.explained[place] for b in blocks])
        usual = float(np.sum(explained[~loud])) / max(int(np.count_nonzero(~loud)), 1)
        share[place] = float(np.sum(explained[loud] - usual)) / above
    best = max(share.values())
    alike = sorted((p for p in share if share[p] >= max(0.93 * best, 0.5)), key=lambda p: -share[p])
    return tuple(sorted(alike, key=lambda p: (not p.startswith("sensor"), p != "steering")))


def _blocks(problem: Problem, one: RunTransfers, run: int, residual: Array) -> _Blocks:
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
    over, every = (
        each - count,
        count.sum(axis=0),
    )  # the noise of n rows has the power n, with the variance 2 n
    loud = over.sum(axis=0) > SIGMAS * np.sqrt(2.0 * every)
    loud |= np.any((over > SIGMAS * np.sqrt(2.0 * count)) & (count == 2.0 * BLOCK), axis=0)
    return _Blocks(over.sum(axis=0), loud, explained)


def _summed(x: Array) -> Array:
    """Sums (..., m) over the blocks of lines (..., k)."""
    whole = x.shape[-1] // BLOCK * BLOCK
    return np.asarray(x[..., :whole].reshape(*x.shape[:-1], -1, BLOCK).sum(axis=-1))
