"""Compare a simulation with recordings in Python: `rs.compare`.

import rover_sweep as rs
runs = rs.read("run1.BIN", "run2.BIN", "run3.BIN", vehicle="rover.toml")
answer = rs.compare(runs, rs.read("sim1.BIN", "sim2.BIN", "sim3.BIN", vehicle="rover.toml"))
answer.differences[0].sentence
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from rover_sweep.api.diagnose import diagnose
from rover_sweep.api.read import Runs
from rover_sweep.comparison.answer import Comparison
from rover_sweep.comparison.common_model import FittedSide
from rover_sweep.comparison.compare import Compared
from rover_sweep.comparison.compare import compare as sides_compared
from rover_sweep.data.recording import Recording
from rover_sweep.diagnosis.result import Diagnosis
from rover_sweep.diagnosis.simulation.experiment import experiment, in_order
from rover_sweep.errors import DataRefused, UsageError

HALF = 0.5  # probability of something without a name, from which none is given


def compare(
    runs: Runs,
    simulated: Sequence[Recording],
    held_out: Sequence[Recording] = (),
    *,
    diagnosis: Diagnosis | None = None,
    effects: Sequence[str] | None = None,
    seed: int = 1,
    progress: Callable[[str, float], None] | None = None,
    stop: Callable[[], bool] | None = None,
) -> Comparison:
    """Compare a simulation with the recordings whose steering and speed drove it.

    simulated: runs of the simulation, from any simulator, each with the steering of one of `runs` or
    `held_out`. held_out: recorded runs that only check the answer. diagnosis: of `runs`, made if missing.
    effects: names of the laws that the simulation has, where they are known; None searches them.
    UsageError for wrong arguments, DataRefused for runs that cannot be compared.
    """
    if not isinstance(runs, Runs) or runs.vehicle is None:
        raise UsageError(
            'the first argument must be runs with their vehicle: rs.read(..., vehicle="rover.toml")'
        )
    if not len(simulated):
        raise UsageError(
            "there is no simulated run to compare; give rs.read(...) of the simulation's recordings"
        )
    found = diagnosis or diagnose(runs, held_out, seed=seed, progress=progress, stop=stop)
    return compared(
        tuple(runs), tuple(held_out), tuple(simulated), found, effects, seed, progress, stop
    ).answer


def compared(
    runs: Sequence[Recording],
    held_out: Sequence[Recording],
    simulated: Sequence[Recording],
    found: Diagnosis,
    effects: Sequence[str] | None = None,
    seed: int = 1,
    progress: Callable[[str, float], None] | None = None,
    stop: Callable[[], bool] | None = None,
    fitted: dict[tuple[str, ...], FittedSide] | None = None,
) -> Compared:
    """`compare` with what pictures and corrections need. DataRefused where the recordings were refused.

    fitted: as in `rover_sweep.comparison.compare`, for several comparisons of the same recordings.
    """
    if found.model is None:
        raise DataRefused(f"the recordings cannot be compared with a simulation: {found.sentence}")
    used = [*(experiment(run) for run in runs), *(experiment(run) for run in held_out)]
    ordered = in_order(used)
    return sides_compared(
        ordered[: len(runs)],
        ordered[len(runs) :],
        in_order([experiment(run) for run in simulated]),
        found.model,
        effects,
        seed,
        progress or (lambda what, share: None),
        stop or (lambda: False),
        fitted,
        (found.p_else or 0.0) >= HALF,
    )
