"""What many tests share: the recordings, the vehicle that made them."""

import os
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: two workers share the cores

import pytest

DATA = Path(__file__).parent / "data"


@pytest.hookimpl(optionalhook=True)  # pytest without xdist does not know it
def pytest_xdist_auto_num_workers(config: pytest.Config) -> int:
    """A third of the tests waits for a simulated rover's time: half as many workers again as cores."""
    return -(-3 * (os.cpu_count() or 2) // 2)


@pytest.fixture(scope="session")
def data() -> Path:
    """Recordings of the real firmware that are part of the project."""
    return DATA


@pytest.fixture(scope="session")
def foreign_recordings() -> Path:
    """Recordings of real hardware, which are not part of the project; skips where they are absent."""
    default = Path(__file__).parents[2] / "shared" / "recordings"
    path = Path(os.environ.get("ROVER_SWEEP_RECORDINGS", default))
    if not path.is_dir():
        pytest.skip(f"no recordings at {path}; set ROVER_SWEEP_RECORDINGS")
    return path
