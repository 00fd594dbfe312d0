"""Under- and oversteer from whole identifications of rovers with a servo's lag, whose truth is known."""

import numpy as np
import pytest
from synthetic import GEOMETRY, TRUE, driven

from rover_sweep.identification.grouping import Settings
from rover_sweep.identification.handling import handling
from rover_sweep.identification.models import refitted_with_lag, roll_yaw, with_steering_lag
from rover_sweep.identification.modes import mode_values
from rover_sweep.identification.pipeline import identify
from rover_sweep.manoeuvre.sweep import Sweep

KINDS = {  # word in the sentence: Cf, Cr [N/rad]
    "the rover understeers": (20.0, 52.0),
    "the rover oversteers": (52.0, 26.0),
    "not identified by these runs": (31.0, 33.5),
}
LAG = {"T_s": 0.03, "tau": 0.015}  # s


@pytest.fixture(scope="module", params=KINDS)
def case(request):
    cf, cr = KINDS[request.param]
    others = {n: v for n, v in TRUE.items() if n != "C"}
    apart = roll_yaw(GEOMETRY, tied=False).with_values({**others, "Cf": cf, "Cr": cr})
    run = driven(with_steering_lag(apart).with_values(LAG), Sweep(amplitude=120), noise=0.01, seed=3)
    result = identify([run], GEOMETRY, settings=Settings(models=("roll-yaw",), bootstrap=100))
    return request.param, result, apart


def test_the_truth_is_inside_all_intervals(case):
    words, result, apart = case
    found = result.handling["roll-yaw, Cf and Cr free"]
    fit = result.models["roll-yaw"].variants["Cf and Cr free"]
    true = handling(type(fit)(apart, fit.speed, (), {}, 0.0))
    assert words in found.sentence
    checked = [n for n, q in found.told.items() if q.low is not None and n in true.quantities]
    assert len(checked) >= 5
    for name in checked:
        q = found.told[name]
        assert q.low <= true[name].value <= q.high, name


def test_the_modes_are_those_of_the_poles_and_their_intervals_hold_the_truth(case):
    _, result, apart = case
    model = result.models["roll-yaw"]
    true = mode_values(apart, model.fit.speed)
    assert len(true) == 6 and model.modes.keys() == tuple(true)
    for mode in model.modes:
        assert mode.low <= true[mode.name] <= mode.high, mode.name
        assert result.handling["roll-yaw"][mode.name] == mode
    square = model.modes["yaw_frequency"].value ** 2 * model.modes["roll_frequency"].value ** 2
    assert square == pytest.approx(np.prod(model.fit.structure.poles(model.fit.speed)).real)


def test_a_delay_alone_would_lower_the_front_stiffness(case):
    """The fit without a lag loses 3 % of Cf and more; its refit does not."""
    _, result, apart = case
    fit = result.models["roll-yaw"].variants["Cf and Cr free"]
    again = refitted_with_lag(fit, [g.condition(("r", "ay", "p")) for g in result.groups])
    true = apart.values["Cf"]
    lost = 1.0 - fit["Cf"].value / true
    assert lost > 0.02 and abs(again.structure.values["Cf"] / true - 1.0) < 0.5 * lost
    assert again.covariance.shape == fit.covariance.shape
