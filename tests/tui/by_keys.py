"""The application as `rover-sweep session` and `replay` make it, used by keys and read from its screen."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from typing import Any

import pytest
from seen import text_of
from textual.events import Key

from rover_sweep.cli.main import run as rover_sweep
from rover_sweep.live.source import Source, Update
from rover_sweep.tui.app import SweepApp
from rover_sweep.tui.model.setup import Setup

BETWEEN = 0.05  # s between two keys
_NAMES = {".": "full_stop", ",": "comma", "-": "minus", "+": "plus"}
POLL = 0.1  # s between two looks at the screen, each of which costs as much as drawing it


def application(arguments: Sequence[str], monkeypatch: pytest.MonkeyPatch) -> SweepApp:
    """The application of a command line, not yet shown; nothing of it is remembered afterwards."""
    made: list[SweepApp] = []

    def shown(
        source: Source, setup: Setup | None = None, view: str = "connect", in_browser: bool = False
    ) -> None:
        made.append(SweepApp(source, setup or Setup(), view))

    monkeypatch.setattr("rover_sweep.tui.app.show", shown)
    monkeypatch.setattr("rich.console.Console.is_terminal", True)
    monkeypatch.setattr("rover_sweep.tui.model.setup.memory_file", lambda: None)
    assert rover_sweep(arguments) == 0
    return made[0]


@dataclass
class Person:
    """Presses keys and waits for words on the screen. told: (monotonic s, what the source told)."""

    app: SweepApp
    told: list[tuple[float, Update]] = field(default_factory=list)

    @property
    def screen(self) -> str:
        return text_of(self.app)

    async def press(self, *keys: str) -> None:
        """As a terminal sends them. Not by the pilot, which waits for an idle processor each time."""
        for key in keys:
            self.app.post_message(Key(_NAMES.get(key, key), key if len(key) == 1 else None))
            await asyncio.sleep(BETWEEN)

    async def until(self, *words: str, seconds: float = 30.0) -> float:
        """Waits until all of them stand there; the time [monotonic s]."""
        return await self.when(
            lambda: all(word in self.screen for word in words), " and ".join(words), seconds
        )

    async def when(self, true: Callable[[], bool], what: str, seconds: float = 30.0) -> float:
        end = time.monotonic() + seconds
        while not true():
            assert time.monotonic() < end, f"{what} did not come within {seconds} s:\n{self.screen}"
            await asyncio.sleep(POLL)
        return time.monotonic()

    def when_told(self, kind: type[Any]) -> float:
        """When the latest of that kind came from the source [monotonic s]."""
        return next(t for t, told in reversed(self.told) if isinstance(told, kind))


@asynccontextmanager
async def using(app: SweepApp, size: tuple[int, int] = (80, 24)) -> AsyncIterator[Person]:
    """Shows it until the end of the block; the source is closed as `show` does."""
    told: list[tuple[float, Update]] = []
    start = app.source.start

    def started(tell: Callable[[Update], None]) -> None:
        def noted(one: Update) -> None:
            told.append((time.monotonic(), one))
            tell(one)

        start(noted)

    app.source.start = started  # type: ignore[method-assign]
    try:
        async with app.run_test(size=size) as pilot:
            await pilot.pause()
            yield Person(app, told)
    finally:
        app.source.close()
