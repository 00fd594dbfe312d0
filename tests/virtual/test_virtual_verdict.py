"""A run driven over a poor link gets the verdict and the amplitude of one driven over a good link."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from virtual_faults import weather
from virtual_pipe import FAIR, Weather
from virtual_run import SWEEP, played
from virtual_world import At

from rover_sweep.live.source import Verdict
from rover_sweep.live.verdict import judge

LONG = replace(SWEEP, t_rec=20.0)


def judged(folder: Path, kind: Weather) -> Verdict:
    """From the telemetry alone; at this seed no band is at a limit between two words."""
    outcome = played(
        folder, [(At("straight"), weather("poor", kind))], manoeuvre=LONG, after=1.0, back=1.0, seed=4
    )
    assert outcome.finished is not None and outcome.finished.completed, outcome.said
    return judge(folder / "sweep1.tlog", outcome.finished.span, "sweep1")


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Verdict:
    return judged(tmp_path_factory.mktemp("good"), FAIR)


@pytest.mark.parametrize("kind", [Weather(drop=0.05), Weather(corrupt=0.05), Weather(jitter=0.5)], ids=str)
def test_the_verdict_is_that_of_a_good_link(tmp_path: Path, good: Verdict, kind: Weather) -> None:
    poor = judged(tmp_path, kind)
    assert (poor.advice, good.advice) == ("keep", "keep")
    assert poor.amplitude == pytest.approx(good.amplitude, rel=0.2)
    for response in ("r", "ay"):
        found, wanted = (
            [(b.words, b.coherence) for b in v.bands if b.response == response] for v in (poor, good)
        )
        assert [words for words, _ in found] == [words for words, _ in wanted]
        for (_, coherence), (_, there) in zip(found, wanted, strict=True):
            assert coherence == pytest.approx(there, abs=0.1)
