"""Forms of effects, a servo that sticks, and the order of runs."""

from dataclasses import replace

import numpy as np
import pytest

from rover_sweep.diagnosis.effects import every_form, form_named, forms_of, library
from rover_sweep.diagnosis.effects.steering import jumps, sticks
from rover_sweep.diagnosis.simulation.experiment import RATE, in_order
from tests.diagnosis.planted import sweeps


def test_forms_share_their_id_and_have_names_of_their_own() -> None:
    for effect in library():
        laws = forms_of(effect)
        assert laws[0].name == effect and len({law.name for law in laws}) == len(laws)
        assert all(form_named(law.name) is law and law.id == effect for law in laws)
    assert set(library()) < set(every_form())


def test_a_servo_that_sticks_goes_all_the_way() -> None:
    u = np.array([0.0, 0.01, 0.02, 0.03, 0.02, 0.01, 0.0])
    assert jumps(u, 0.015) == pytest.approx([0.0, 0.0, 0.02, 0.02, 0.02, 0.02, 0.0])
    assert sticks(u, 0.015) == pytest.approx([0.0, 0.0, 0.02, 0.03, 0.03, 0.01, 0.0])


def test_runs_of_one_clock_are_in_the_order_of_driving() -> None:
    one, two = sweeps(1, ((0.1, 2.0), (0.1, 2.0)))
    length = one.t.size / RATE
    early, late = replace(two, begin=10.0), replace(one, begin=20.0 + length)
    placed = in_order([late, early])
    assert [r.order for r in placed] == [1, 0] and placed[0].driven == pytest.approx(float(early.t[-1]))
    again = in_order([replace(late, begin=5.0), replace(early, begin=6.0)])  # after a restart: as given
    assert [r.order for r in again] == [0, 1]
