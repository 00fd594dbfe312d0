"""One study for all tests: it takes about ten seconds."""

import pytest

from rover_sweep.study.virtual_study import Study, study


@pytest.fixture(scope="session", params=[pytest.param(1, marks=pytest.mark.slow)])
def done(request: pytest.FixtureRequest) -> Study:
    """The study of seed 1."""
    return study(request.param)
