"""On healthy rovers nothing is named, and the intervals hold the truth."""

from __future__ import annotations

import pytest
from healthy import examined

from rover_sweep.diagnosis.simulation.single_track import tyre_force
from sitl.plant.tyre import lateral_force


def test_nothing_is_named_on_a_healthy_rover():
    """Seed 1: 1.6 times the nominal length. Its tyres bend by a law of the other simulation."""
    found = examined(1)
    assert found.verdict == "none", found.names
    assert all(found.inside.values()), found.inside


@pytest.mark.slow
def test_at_most_one_of_twenty_healthy_rovers_gets_a_name():
    every = [examined(seed) for seed in range(100, 120)]
    named = {one.seed: one.names for one in every if one.names}
    assert len(named) <= 1, named
    for name in every[0].inside:
        assert sum(one.inside[name] for one in every) >= 16, name


@pytest.mark.parametrize("friction", [0.7, 0.9, 1.2])
def test_the_nominal_tyre_bends_as_a_magic_formula_does(friction):
    """Up to half of the peak force, within 1 % of the force."""
    bend, load = 0.735 / friction**2, 13.0
    for share in (0.1, 0.3, 0.5):
        alpha = share * friction * load / 31.0
        theirs = lateral_force(alpha, 31.0, friction * load, 1.3)
        assert tyre_force(alpha, 31.0, load, 1.0 / load, 0.0, bend, 0.0) == pytest.approx(theirs, rel=0.01)
