"""Recorded and simulated signals and responses of pairs of runs, for the pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rover_sweep.comparison.answer import Bode
from rover_sweep.comparison.common_model import FittedSide
from rover_sweep.comparison.differences import Found
from rover_sweep.comparison.direct import Direct
from rover_sweep.comparison.pairing import Pair
from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.held_out.worth import SWEPT, frequency_responses_of, overlay_of
from rover_sweep.diagnosis.problem.noise_floor import Floor
from rover_sweep.diagnosis.problem.residuals import centred
from rover_sweep.diagnosis.result import Overlay
from rover_sweep.diagnosis.simulation.experiment import Experiment
from rover_sweep.diagnosis.simulation.simulator import Sensors, logged

Signals = dict[str, Array]


@dataclass(frozen=True, eq=False)
class BeforeAfter:
    """A recorded run with two simulations of it {channel: (n,)} on its grid, and the noise of both sides."""

    run: Experiment
    before: Signals
    after: Signals
    floor: Floor
    held_out: bool


def predicted(
    compared: Direct, recordings: FittedSide, found: Found, held_out: bool
) -> tuple[BeforeAfter, ...]:
    """The simulated runs, and the same plus what the differences that were found change."""
    structure, out = recordings.fitted.structure, []
    for pair in compared.pairs:
        sensors = Sensors.of(pair.recorded)
        ends = [logged(pair.recorded, structure, x[0], sensors) for x in (found.recordings, found.simulation)]
        before = simulated_log(pair)
        after = {c: y + ends[0][c] - ends[1][c] for c, y in before.items() if c in ends[0]}
        out.append(BeforeAfter(pair.recorded, before, after, compared.problem.floor, held_out))
    return tuple(out)


def driven_again(before: Direct, after: Direct, held_out: bool) -> tuple[BeforeAfter, ...]:
    """Two simulations of the same recorded runs."""
    first = {pair.recorded.name: pair for pair in before.pairs}
    return tuple(
        BeforeAfter(
            pair.recorded,
            simulated_log(first[pair.recorded.name]),
            simulated_log(pair),
            after.problem.floor,
            held_out,
        )
        for pair in after.pairs
        if pair.recorded.name in first
    )


def simulated_log(pair: Pair) -> Signals:
    """The simulated run {channel: (n,)} on the recorded run's grid."""
    t, at = pair.recorded.t + pair.late, pair.simulated.t
    log = centred(pair.simulated)
    return {c: np.interp(t, at, log[c]) for c in pair.recorded.measured if c in log}


def histories_of(runs: Sequence[BeforeAfter]) -> tuple[Overlay, ...]:
    """Time histories over each other, with the spectra of the residuals over the noise."""
    return tuple(
        overlay_of(one.run, c, one.held_out, one.before[c], one.after[c], one.floor)
        for one in runs
        for c in _channels(one)
    )


def bode(runs: Sequence[BeforeAfter]) -> tuple[Bode, ...]:
    """Responses of the first run that is a sweep; none without one."""
    for one in runs:
        if one.run.kind in SWEPT:
            return _bode(one)
    return ()


def _channels(one: BeforeAfter) -> list[str]:
    return [c for c in one.run.measured if c in one.before and c in one.after and c in one.floor.density]


def _bode(one: BeforeAfter) -> tuple[Bode, ...]:
    run = one.run
    logs = (centred(run), one.before, one.after)
    measured, before, after = (frequency_responses_of(run, log) for log in logs)
    return tuple(
        Bode(
            run.name,
            one.held_out,
            output,
            found.w,
            found.h,
            before[output].at(found.w)[0],
            after[output].at(found.w)[0],
            found.coherence,
            found.band,
        )
        for output, found in measured.items()
        if output in before and output in after
    )
