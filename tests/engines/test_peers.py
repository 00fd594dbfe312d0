"""The peers on invented discrepancies, and their table of names."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("pysindy")
pytest.importorskip("sklearn")

from rover_sweep.diagnosis.effects import library
from tests.engines.peer_residuals import EQUATIONS, Discrepancy
from tests.engines.peer_terms import READ, terms
from tests.engines.peers import Compared, gaussian, sparse, summary

NAMES = ("delta", "delta'", "V", "v", "r", "r'", "p", "p'", "phi", "a_y", "psi")


def invented(seed: int, damping: float) -> Discrepancy:
    """Independent signals; a yaw acceleration of -damping r is missing, the noise has rms 1 and .3."""
    rng = np.random.default_rng(seed)
    x = {name: rng.normal(size=800) for name in NAMES}
    yaw, lateral = rng.normal(size=800) - damping * x["r"], 0.3 * rng.normal(size=800)
    return Discrepancy({"yaw": yaw, "lateral": lateral}, {"yaw": 1.0, "lateral": 0.3}, x)


@pytest.mark.slow
def test_both_learn_a_missing_yaw_damping_and_only_one_names_it() -> None:
    used, held = [invented(k, 3.0) for k in range(3)], [invented(9, 3.0)]
    one, other = sparse(used, held), gaussian(used, held)
    assert one.names == ("yaw_damping",) and one.said[0].startswith("yaw: -3.")
    assert one.removed is not None and one.removed > 0.9
    assert other.names == () and other.removed is not None and other.removed > 0.8


@pytest.mark.slow
def test_nothing_is_named_where_nothing_is_missing() -> None:
    used, held = [invented(k, 0.0) for k in range(3)], [invented(9, 0.0)]
    assert sparse(used, held).names == () and sparse(used, held).removed is None


def test_every_term_is_read_as_an_effect_of_the_list_or_as_none() -> None:
    for equation in EQUATIONS:
        assert list(READ[equation]) == list(terms(invented(1, 0.0).signals))
        assert set(READ[equation].values()) - {""} <= set(library())


def test_a_summary_line() -> None:
    text = summary("single", [Compared(1, 0, 0.7, 0.2), Compared(0, 2, None, None)])
    assert "named 1 of 2 rightly and 2 wrongly, in 1/2 sets" in text
    assert text.endswith("pysindy 1/1, Gaussian process 0/1")
