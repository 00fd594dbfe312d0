from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from synthetic_servo import VARIANT

from sitl.launcher import start_embedded

ROOT = Path(__file__).parents[2]
OnBlocks = Callable[..., str]


@pytest.fixture
def on_blocks(tmp_path: Path) -> Iterator[OnBlocks]:
    """Start an embedded rover with play, an uneven gain and a slow servo; returns its URL."""
    variant = tmp_path / "variant.toml"
    variant.write_text(VARIANT)
    with ExitStack() as stack:

        def start(*options: str) -> str:
            given = ("--parameter", "SCHED_LOOP_RATE=100", *options)
            return stack.enter_context(
                start_embedded(tmp_path / "rover", variant=variant, options=given)
            ).connection

        yield start


@pytest.fixture
def vehicle_toml(tmp_path: Path) -> Path:
    """A vehicle file of its own, with its comments."""
    return Path(shutil.copy(ROOT / "tests" / "data" / "rover.toml", tmp_path / "rover.toml"))
