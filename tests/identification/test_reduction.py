"""Structure reduction: physical parameters go back to what the vehicle file says, step by step."""

from dataclasses import replace

import numpy as np
import pytest
from synthetic import GEOMETRY, TRUE, driven

import rover_sweep as rs
from rover_sweep.identification.fit import Condition, ResponseData, fit
from rover_sweep.identification.grouping import Settings
from rover_sweep.identification.models import roll_yaw
from rover_sweep.identification.pipeline import identify
from rover_sweep.identification.verdicts import reduce_model
from rover_sweep.manoeuvre.sweep import Sweep

FREED = ("Ixx", "Ixz", "h")
FREE_GEOMETRY = replace(GEOMETRY, free=FREED)
TRUTH = roll_yaw(GEOMETRY).with_values(TRUE)
ROLL_YAW = Settings(models=("roll-yaw",))


@pytest.fixture(scope="module")
def run():
    return driven(TRUTH, Sweep(amplitude=120), noise=0.01, seed=4)


@pytest.fixture(scope="module")
def nominal(data):
    folder = data / "ardurover-4.6.3" / "nominal"
    return rs.read(folder / "run1.BIN", folder / "run2.BIN", vehicle=data / "rover.toml")


def fixed(model) -> dict[str, float]:
    return {s.parameter: s.value for s in model.reduction if s.dropped}


@pytest.mark.slow
def test_what_the_papers_authors_fixed_is_fixed_on_the_virtual_rover(nominal):
    """Table 3: Ixx at the swing test's value, Ixz at zero, h at the observed geometry; the rest free."""
    model = rs.identify(nominal, models=["roll-yaw"], free=FREED).models["roll-yaw"]
    assert fixed(model) == {"Ixx": 0.0125, "Ixz": 0.0, "h": 0.058}
    assert [e.name for e in model.fit.estimates if e.free] == ["Cf", "Cr", "Izz", "k_phi", "b_phi", "tau"]
    assert model.fit["Izz"].value == pytest.approx(0.071, rel=0.06)
    before = model.variants["before reduction"]
    assert abs(before["k_phi"].value / 10.8 - 1) > 0.3 > abs(model.fit["k_phi"].value / 10.8 - 1)


def test_every_step_says_why_and_what_it_cost(run):
    model = identify([run], FREE_GEOMETRY, settings=ROLL_YAW).models["roll-yaw"]
    assert set(fixed(model)) == set(FREED)
    assert model.reduction[0].before == pytest.approx(model.variants["before reduction"].average)
    assert model.reduction[-1].after == pytest.approx(model.fit.average)
    for step, following in zip(model.reduction, model.reduction[1:], strict=False):
        assert following.before == (step.after if step.dropped else step.before)
    assert all("% > " in s.reason for s in model.reduction)
    assert model.reduction[0].found == model.variants["before reduction"][model.reduction[0].parameter].value


def test_it_is_reproducible(run):
    first, second = (identify([run], FREE_GEOMETRY, settings=ROLL_YAW).models["roll-yaw"] for _ in range(2))
    assert first.reduction == second.reduction
    assert [e.value for e in first.fit.estimates] == [e.value for e in second.fit.estimates]


def test_it_can_be_stopped_and_told_what_to_keep(run):
    off = identify([run], FREE_GEOMETRY, settings=replace(ROLL_YAW, reduction=False)).models["roll-yaw"]
    assert not off.reduction and off.fit["Ixz"].free and "before reduction" not in off.variants
    kept = identify([run], FREE_GEOMETRY, settings=replace(ROLL_YAW, keep=("h",))).models["roll-yaw"]
    assert kept.fit["h"].free and "h" not in {s.parameter for s in kept.reduction}
    lumped = Settings(models=("lumped",), reduction=False)
    full = identify([run], GEOMETRY, settings=lumped).models["lumped"]
    assert not full.reduction and sum(e.free for e in full.fit.estimates) == 16


def test_a_vehicle_file_that_is_wrong_is_not_forced_on_the_data():
    """The roll inertia of the file is three times the true one: fixing it there would spoil the fit."""
    structure = roll_yaw(replace(GEOMETRY, roll_inertia=3 * GEOMETRY.roll_inertia))
    w = np.geomspace(0.4, 18, 20)
    seen = {o: ResponseData(o, w, TRUTH.response(w, 2.4, o), np.full(20, 0.6)) for o in ("r", "ay", "p")}
    condition = Condition(2.4, tuple(seen.values()), {})
    start = structure.with_free([*(p.name for p in structure.free), "Ixx"])
    result, steps = reduce_model(fit(start, [condition]), [condition], {"Ixx": structure.values["Ixx"]})
    assert [(s.parameter, s.dropped) for s in steps] == [("Ixx", False)]
    assert result["Ixx"].value == pytest.approx(GEOMETRY.roll_inertia, rel=0.01)
