"""The numbers of an identified rover, with what its vehicle file and its parts leave open allowed for."""

from __future__ import annotations

from dataclasses import replace

from rover_sweep.api.known_steering import known
from rover_sweep.data.by_name import ByName
from rover_sweep.data.intervals import LEVEL, Intervals
from rover_sweep.data.vehicle_file import Vehicle
from rover_sweep.data.vehicle_geometry import tolerances_of
from rover_sweep.identification.acceptance import identified_runs, usable
from rover_sweep.identification.fit import Estimate
from rover_sweep.identification.pipeline import Identification
from rover_sweep.identification.recommendation import PHYSICAL

CHANNELS = {"r": "r", "ay": "ay", "p": "p", "vydot": "vy"}  # {response: what is recorded of it}
SEED = 1
WIDTH = 3.29  # of a Gaussian's 90 % interval, in standard deviations


def with_numbers(found: Identification, vehicle: Vehicle) -> Identification:
    """The identification with `numbers`, or with a sentence on why there are none.

    None unless the most complete model with tyres that the runs determine is the recommended one, and none
    where it differs from the runs by more than the noise and normal tolerances: numbers of a wrong model are
    no rover's.
    """
    models = usable(found)
    name = next((n for n in PHYSICAL if n in models), "")  # the most complete one that the runs determine
    if not name or found.recommended != name:
        return found
    from rover_sweep.diagnosis.posterior.rover_numbers import fitted_baseline, rover_numbers
    from rover_sweep.diagnosis.verdict import NOTABLE

    wanted = {CHANNELS.get(output) for output in models[name].fit.costs}
    left_out = set(CHANNELS.values()) - wanted
    runs = [
        replace(run, channels={c: s for c, s in run.channels.items() if c not in left_out})
        for run in identified_runs(found)
    ]
    spread = known(vehicle, tolerances_of(vehicle)).spread
    fitted = fitted_baseline(runs, found.geometry, name, spread)  # type: ignore[arg-type]
    if fitted is None:
        return found
    channel, misfit = max(fitted.misfit.items(), key=lambda item: item[1])
    if misfit > NOTABLE:
        why = (
            f"the {name} model differs from the runs by {misfit**0.5:.1f} times the noise in {channel}, more "
            "than normal tolerances of a rover: its numbers hold for the fitted responses alone; "
            "`rover-sweep diagnose` with the same runs finds what it leaves out"
        )
        return replace(found, summary=(*found.summary, why))
    return replace(
        found,
        numbers=ByName(
            Estimate(
                v.name,
                v.unit,
                v.value,
                True,
                None,
                None,
                meaning=v.meaning,
                interval=Intervals(v.name, v.low, v.high, LEVEL, (v.high - v.low) / WIDTH, 0.0, 0, 0),
            )
            for v in rover_numbers(fitted, SEED)
            if v.low is not None and v.high is not None
        ),
    )
