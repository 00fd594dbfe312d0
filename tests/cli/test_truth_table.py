"""The numbers that a dry run sets beside the identified ones are those that the plant drives with."""

from __future__ import annotations

from pathlib import Path

import pytest

from rover_sweep.cli.driving.simulated import truth
from sitl.plant.effects.replaced_numbers import resolved
from sitl.plant.variant import load_variant


def test_effects_of_a_variant_show_in_the_truth(tmp_path: Path) -> None:
    path = tmp_path / "slow.toml"
    path.write_text(
        'base = "nominal"\n[effects]\nservo_lag = { T = 0.09 }\nfront_rear_stiffness = { ratio = 1.5 }\n'
    )
    true, nominal = truth(resolved(load_variant(path))), truth(load_variant("nominal"))
    assert true["tau"] == pytest.approx(0.09 + 0.015)
    assert true["Cf"] / true["Cr"] == pytest.approx(1.5) and true["C"] == pytest.approx(nominal["C"])
    assert true["Izz"] == nominal["Izz"]
