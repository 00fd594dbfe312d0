"""A model that fits is not called good where its sensors' filters are assumed or no run is whole."""

from __future__ import annotations

from dataclasses import replace

import pytest
from synthetic import GEOMETRY, TRUE, driven

from rover_sweep.data.recording import ASSUMED, LowPass, Note, Recording
from rover_sweep.identification.grouping import Settings
from rover_sweep.identification.models import roll_yaw
from rover_sweep.identification.pipeline import identify
from rover_sweep.manoeuvre.sweep import Sweep
from rover_sweep.quality.faults import doubts

SETTINGS = Settings(models=("bicycle",), bootstrap=0)
CUT = Note("warning", "The recording ends before the end of the run: it ends at 28 s.")


@pytest.fixture(scope="module")
def run() -> Recording:
    return driven(roll_yaw(GEOMETRY).with_values(TRUE), Sweep(amplitude=120, t_rec=30, w_min=1.0))


def level(run: Recording) -> tuple[str, str]:
    verdict = identify([run], GEOMETRY, settings=SETTINGS).models["bicycle"].verdict
    return verdict.level, verdict.sentences[0]


def test_a_model_of_whole_and_known_data_is_good(run: Recording) -> None:
    assert not list(doubts([run])) and level(run)[0] == "good"


def test_an_assumed_filter_is_a_doubt(run: Recording) -> None:
    assumed = replace(run, filters={"r": LowPass(20.0, ASSUMED), "ay": LowPass(20.0, "INS_ACCEL_FILTER")})
    found, why = level(assumed)
    assert found == "acceptable" and why.startswith("the low-pass of r was not recorded")


def test_a_run_that_is_not_whole_is_a_doubt_where_none_is(run: Recording) -> None:
    cut = replace(run, name="cut", notes=(CUT,))
    found, why = level(cut)
    assert found == "acceptable" and why.startswith("no run was recorded completely (cut)")
    assert not list(doubts([cut, run]))
