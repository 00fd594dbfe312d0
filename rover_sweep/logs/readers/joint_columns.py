"""Which columns belong together: yaw rate, speed, lateral acceleration and steering, by one joint score.

The score of a set of columns is the logarithm of its odds: what their names say, and how well the relations
of any steered vehicle hold between them. The slope of the heading is r, that of the path V, a_y = V r, and r
follows V times the steering. A name shifts the odds, and a column that fits far better overrules it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from rover_sweep.logs.readers.column_grid import ColumnGrid, fit_odds
from rover_sweep.logs.readers.motion_columns import MotionColumns, motion_candidates, with_scale
from rover_sweep.logs.readers.steering_columns import ALIKE, SteeringFit, steering_candidates

TRIED = 12  # sets of yaw rate, speed and acceleration with which the steering is looked for
LEAST = 1.0  # of the logarithm of the odds, from which there is a yaw rate at all
STEERED = (
    0.95  # share that a steering explains, from which more says no more about the yaw rate: one that was
)
# computed from the steering follows it better than a measured one


@dataclass(frozen=True)
class JointColumns:
    """The best set of columns. steering: candidates, best first; why: there is none.

    others: {role: columns that fit alike, of the yaw rate ("r") and the speed}.
    """

    motion: MotionColumns = MotionColumns()
    steering: tuple[SteeringFit, ...] = ()
    why: str = ""
    others: Mapping[str, tuple[str, ...]] = field(default_factory=dict)


def joint_columns(grid: ColumnGrid) -> JointColumns:
    """The set of columns with the best odds; without a yaw rate where no column is likely to be one."""
    scored: list[tuple[float, MotionColumns]] = []
    for odds, motion in motion_candidates(grid)[:TRIED]:
        steering, _ = steering_candidates(grid, motion)
        scored.append((odds + _of_steering(steering), motion))
    if not scored or max(odds for odds, _ in scored) < LEAST:
        return JointColumns()
    best, chosen = max(scored, key=lambda pair: pair[0])
    others = {
        role: tuple(
            dict.fromkeys(
                getattr(motion, role)
                for odds, motion in scored
                if odds > best - ALIKE
                and getattr(motion, role) not in (getattr(chosen, role), *grid.made)
                and all(getattr(motion, same) == getattr(chosen, same) for same in {"r", "speed"} - {role})
            )
        )
        for role in ("r", "speed")
    }
    motion = with_scale(grid, chosen)
    steering, why = steering_candidates(grid, motion)
    return JointColumns(motion, steering, why, others)


def _of_steering(steering: tuple[SteeringFit, ...]) -> float:
    """What the best steering says for the other columns."""
    if not steering:
        return 0.0
    best = steering[0]
    return max(0.0, best.odds - fit_odds(best.share) + fit_odds(min(best.share, STEERED)))
