from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest
from synthetic_servo import VARIANT

from sitl.launcher import start_embedded

ROOT = Path(__file__).parents[2]
OnBlocks = Callable[..., str]


@contextmanager
def rover_on_blocks(folder: Path, *options: str) -> Iterator[str]:
    """The URL of an embedded rover with play, an uneven gain and a slow servo."""
    variant = folder / "variant.toml"
    variant.write_text(VARIANT)
    given = ("--parameter", "SCHED_LOOP_RATE=100", *options)
    with start_embedded(folder / "rover", variant=variant, options=given) as rover:
        yield rover.connection


@pytest.fixture
def on_blocks(tmp_path: Path) -> Iterator[OnBlocks]:
    """Starts one with these options."""
    with ExitStack() as stack:
        yield lambda *options: stack.enter_context(rover_on_blocks(tmp_path, *options))


@pytest.fixture(scope="module")
def refusing_url(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """One for all tests in which nothing moves."""
    with rover_on_blocks(tmp_path_factory.mktemp("refusing")) as url:
        yield url


@pytest.fixture
def vehicle_toml(tmp_path: Path) -> Path:
    """A vehicle file of its own, with its comments."""
    return Path(shutil.copy(ROOT / "tests" / "data" / "rover.toml", tmp_path / "rover.toml"))
