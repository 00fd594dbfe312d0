"""Detectable sizes of this very plan: from which a diagnosis of its runs is expected to name an effect.

The tool is asked, on runs of the same rover, plan and noise in which nothing is hidden. An effect that is
named only above `MOST` times its estimate in sizes.toml has none in this plan. Only the first parameter of an
effect is asked about; its further ones keep their estimates.
"""

from __future__ import annotations

from pathlib import Path

from rover_sweep.api.investigation import as_planned
from rover_sweep.api.read import read
from rover_sweep.data.geometry import Tolerances
from rover_sweep.data.vehicle_geometry import geometry_of
from rover_sweep.diagnosis.plans.plan import detectable
from rover_sweep.diagnosis.plans.planner import Planner
from rover_sweep.diagnosis.simulation.experiment import experiment
from tests.concealed.effects import ids, table

MOST = 3.0

Sizes = dict[str, dict[str, float]]


def sizes(folder: Path) -> Sizes:
    """{effect: {parameter: physical size}} for the runs 1 to 3 of a set that hides nothing."""
    runs = read(*(folder / f"run{k}.BIN" for k in (1, 2, 3)), vehicle=folder / "rover.toml")
    driven = {run.name: experiment(run) for run in runs}
    planned = [as_planned(run, runs.vehicle) for run in runs]
    _, rad_per_us = runs.vehicle.steering()
    planner = Planner(geometry_of(runs.vehicle), abs(rad_per_us), (), Tolerances(), driven, lambda *_: None)
    found = detectable(planner, planned)
    out: Sizes = {}
    for effect in ids():
        own = dict(table()[effect]["parameters"])
        one = found.get(effect)
        if one is None and effect in planner.asked:
            continue
        if one is not None and one.parameter in own:
            p = planner.assumed.first(effect)
            if abs(p.coordinate(one.size or 0.0)) > MOST * abs(p.coordinate(own[one.parameter])):
                continue
            own[one.parameter] = one.size or 0.0
        out[effect] = own
    return out
