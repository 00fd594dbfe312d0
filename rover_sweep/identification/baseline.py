"""The model that a diagnosis tests if the user names none: the most complete one that the runs determine.

As in `recommendation`, tyres are no part of it where the kinematic model fits as well, and roll is none where
the roll rate does not follow the steering. A poor fit counts for nothing here: what it lacks is asked for.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from rover_sweep.data.geometry import Geometry
from rover_sweep.identification.cost import costs
from rover_sweep.identification.fit import fit
from rover_sweep.identification.grouping import Group, Settings
from rover_sweep.identification.model_results import NotPossible, Work, need_roll
from rover_sweep.identification.models.bicycle import bicycle
from rover_sweep.identification.models.kinematic import kinematic
from rover_sweep.identification.starts import drawn_starts
from rover_sweep.identification.verdicts import kinematic_suffices

Determined = Literal["roll-yaw", "bicycle", "kinematic"]


def determined_model(groups: Sequence[Group], geometry: Geometry) -> tuple[Determined, str]:
    """(the most complete model that the groups determine, why no more complete one; "" for the roll-yaw)."""
    sound = tuple(g for g in groups if not g.why_not())
    if not sound:  # refused later, with the reason
        return "roll-yaw", ""
    work = Work(sound, geometry, (), Settings())
    found = {}
    for structure in (kinematic(geometry), bicycle(geometry)):
        best = fit(structure, work.conditions(), drawn_starts(structure)).structure
        found[structure.name] = costs(best, work.conditions(structure.outputs))
    if why := kinematic_suffices(found):
        return "kinematic", why
    try:
        need_roll("roll-yaw", work)
    except NotPossible as reason:
        return "bicycle", str(reason)
    return "roll-yaw", ""
