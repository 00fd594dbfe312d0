"""What many tests share: the recordings, the vehicle that made them."""

import gc
import os
import signal
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: two workers share the cores

import pytest

# A shell starts what it puts into the background with these ignored; tests send them to programs.
signal.signal(signal.SIGINT, signal.default_int_handler)
if hasattr(signal, "SIGQUIT"):
    signal.signal(signal.SIGQUIT, signal.SIG_DFL)

DATA = Path(__file__).parent / "data"
# folders whose conftest.py identifies or drives
SHARING = ("tests/api", "tests/gains", "tests/report", "tests/study")
LONG = (  # a minute of one core or more
    "tests/tui/test_tui_on_rover",
    "tests/virtual/test_virtual_matrix",
    "tests/diagnosis/test_diagnosed_recordings",
    "tests/diagnosis/test_healthy_rovers",
    "tests/comparison",
    "tests/engines",
    "tests/house",
    "tests/acceptance",
)


@pytest.hookimpl(optionalhook=True)  # pytest without xdist does not know it
def pytest_xdist_auto_num_workers(config: pytest.Config) -> int:
    """A third of the tests waits for a simulated rover's time: half as many workers again as cores."""
    return -(-3 * (os.cpu_count() or 2) // 2)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """A file's tests run in one process, so that what they share is made once; in SHARING a folder's."""
    from xdist.scheduler import LoadScopeScheduling

    class Scheduling(LoadScopeScheduling):
        def _split_scope(self, nodeid: str) -> str:
            file = nodeid.partition("::")[0]
            folder = file.rpartition("/")[0]
            return folder if folder in SHARING else file

    config.option.loadscopereorder = False
    return Scheduling(config, log)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The long ones first: none of them is to run alone at the end."""
    items.sort(key=lambda item: not item.nodeid.startswith(LONG))


def pytest_collection_finish() -> None:
    """The tests and the libraries stay: the collector of garbage need not look through them each time."""
    gc.collect()
    gc.freeze()


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
