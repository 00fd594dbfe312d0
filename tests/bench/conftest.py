from __future__ import annotations

import json
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest
from synthetic_servo import VARIANT

ROOT = Path(__file__).parents[2]
OnBlocks = Callable[..., str]


@contextmanager
def _embedded(directory: Path, options: tuple[str, ...]) -> Iterator[str]:
    command = [sys.executable, "-m", "sitl.embedded", "--directory", str(directory), *options]
    program = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT)
    try:
        assert program.stdout is not None
        yield f"tcp:127.0.0.1:{json.loads(program.stdout.readline())['tcp']}"
    finally:
        program.send_signal(signal.SIGTERM)
        program.wait(5.0)


@pytest.fixture
def on_blocks(tmp_path: Path) -> Iterator[OnBlocks]:
    """Start an embedded rover with play, an uneven gain and a slow servo; returns its URL."""
    variant = tmp_path / "variant.toml"
    variant.write_text(VARIANT)
    with ExitStack() as stack:

        def start(*options: str) -> str:
            given = ("--variant", str(variant), "--parameter", "SCHED_LOOP_RATE=100", *options)
            return stack.enter_context(_embedded(tmp_path / "rover", given))

        yield start


@pytest.fixture
def vehicle_toml(tmp_path: Path) -> Path:
    """A vehicle file of its own, with its comments."""
    return Path(shutil.copy(ROOT / "tests" / "data" / "rover.toml", tmp_path / "rover.toml"))
