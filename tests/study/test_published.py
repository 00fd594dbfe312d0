"""The transcription of the paper's tables, by what must hold among its own numbers."""

import numpy as np
import pytest

from rover_sweep.study import published
from rover_sweep.study.published import MODELS


@pytest.mark.parametrize("model", MODELS)
def test_averages_of_table_5_are_those_of_their_columns(model: str) -> None:
    column = {o: j for o, j in published.COSTS[model].items() if o != "average"}
    assert np.mean(list(column.values())) == pytest.approx(published.COSTS[model]["average"], abs=0.06)
    assert ("p" in column) == (model != "bicycle")


@pytest.mark.parametrize("model", MODELS)
def test_every_printed_bound_is_at_least_twice_its_insensitivity(model: str) -> None:
    """CR/I >= 2 by equations (13) and (14)."""
    free = [p for p in published.PARAMETERS[model].values() if p.free]
    assert free and all(p.cr >= 2 * p.insensitivity for p in free)  # type: ignore[operator]


def test_table_4_has_fifteen_derivatives_and_a_delay_five_of_them_zero() -> None:
    rows = published.PARAMETERS["lumped"]
    assert len(rows) == 16
    assert {n for n, p in rows.items() if not p.free} == {"Y_v", "Y_r", "Y_phi", "L_v", "L_phi"}


def test_tables_6_and_7_lie_within_their_definition() -> None:
    rows = [v for check in published.VERIFICATION.values() for v in check.values()]
    assert len(rows) == 9 and all(0 < v.tic < 1 and v.j_rms > 0 for v in rows)
