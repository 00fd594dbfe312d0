"""One study for all tests: it takes about ten seconds."""

import pytest

from rover_sweep.study.virtual_study import Study, study


@pytest.fixture(scope="session")
def done() -> Study:
    """The study of seed 1."""
    return study(1)
