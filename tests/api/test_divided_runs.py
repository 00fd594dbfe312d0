"""Which runs are identified from, and which are kept for verification."""

from __future__ import annotations

import numpy as np
import pytest

from rover_sweep.api.diagnosis_input import material
from rover_sweep.api.read import divided
from rover_sweep.data.recording import Kind, Recording, Signal
from rover_sweep.errors import DataRefused


def recording(name: str, kind: Kind) -> Recording:
    t = np.arange(0.0, 10.0, 0.01)
    channels = {"r": Signal(t, np.zeros(t.size), "rad/s", "test")}
    return Recording(name, channels, (0.0, 10.0), kind, sources=((name, name),))


def names(runs: tuple[Recording, ...]) -> list[str]:
    return [run.name for run in runs]


def test_a_sweep_about_an_offset_is_not_mixed_with_straight_ones_and_that_is_said() -> None:
    runs = [
        recording("bent", "bias_sweep"),
        recording("a", "sweep"),
        recording("b", "multisine"),
        recording("d", "doublet"),
    ]
    fitted, checks = divided(runs)
    assert (names(fitted), names(checks)) == (["a", "b"], ["d"])
    (note,) = fitted[0].notes
    assert note.level == "warning" and note.text.startswith("bent is not fitted")
    assert fitted[1].notes == ()


@pytest.mark.parametrize("kind", ["sweep", "bias_sweep", "other"])
def test_runs_of_one_kind_are_all_identified_from(kind: Kind) -> None:
    fitted, checks = divided([recording("a", kind), recording("b", kind)])
    assert (names(fitted), checks) == (["a", "b"], ())
    assert all(not run.notes for run in fitted)


def test_a_diagnosis_drives_every_run_by_itself_and_keeps_them_all() -> None:
    given = material(
        [recording("bent", "bias_sweep"), recording("a", "sweep"), recording("d", "doublet")], ()
    )
    assert (names(given.runs), names(given.held_out)) == (["bent", "a"], ["d"])


def test_doublets_alone_need_a_sweep() -> None:
    with pytest.raises(DataRefused, match="^a is a doublet; a sweep is needed: "):
        divided([recording("a", "doublet")])
    with pytest.raises(DataRefused, match="^a, b are doublets; a sweep is needed: "):
        divided([recording("a", "doublet"), recording("b", "doublet")])
