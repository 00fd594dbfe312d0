"""Every screen as text, at both sizes, light and dark, against what is committed.

    ROVER_SWEEP_SNAPSHOTS=write python -m pytest tests/tui/test_tui_snapshots.py

writes them anew; look at the difference before it is committed.
"""

from __future__ import annotations

import asyncio
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from scenes import WORKED_OUT, all_scenes, playing
from seen import coloured, text_of
from textual.app import App
from wcag_contrast import LEAST_CONTRAST, contrast

SNAPSHOTS = Path(__file__).parent / "snapshots"
SIZES = ((80, 24), (200, 60))
SCENES = all_scenes()


@dataclass(frozen=True)
class Seen:
    """A screen at a size; poor: (text, colour, ground) of what stands out too little."""

    size: tuple[int, int]
    light: str
    dark: str
    poor: tuple[tuple[str, str, str], ...]


@pytest.mark.parametrize("name", SCENES)
def test_screen(name: str) -> None:
    for seen in asyncio.run(_seen(name)):
        path = SNAPSHOTS / f"{name}-{seen.size[0]}x{seen.size[1]}.txt"
        if os.environ.get("ROVER_SWEEP_SNAPSHOTS") == "write":
            path.write_text(seen.light, encoding="utf-8")
        assert seen.light == path.read_text(encoding="utf-8")
        assert seen.dark == seen.light, "a word, never a colour alone, tells one thing from another"
        assert not seen.poor
        assert "cannot be drawn" not in seen.light
        rows = seen.light.splitlines()
        assert len(rows) == seen.size[1] and all(len(row) <= seen.size[0] for row in rows)


async def _seen(name: str) -> list[Seen]:
    """At each size, light and dark."""
    steps, setup = SCENES[name]
    found = []
    async with playing(steps, SIZES[0], setup) as (app, _, pilot):
        if name in WORKED_OUT:
            app.analyses.jobs = WORKED_OUT[name]
            app.redraw()
        for size in SIZES:
            await pilot.resize_terminal(*size)
            looks = []
            for _ in ("light", "dark"):
                await pilot.pause()
                looks.append((text_of(app), tuple(_poor(app))))
                app.action_colours()
            (light, poor), (dark, poor_too) = looks
            found.append(Seen(size, light, dark, poor + poor_too))
    return found


def _poor(app: App[None]) -> Iterator[tuple[str, str, str]]:
    return (seen for seen in coloured(app) if contrast(seen[1], seen[2]) < LEAST_CONTRAST)


def test_no_snapshot_is_left_over() -> None:
    names = {f"{name}-{w}x{h}.txt" for name in SCENES for w, h in SIZES}
    assert {path.name for path in SNAPSHOTS.glob("*.txt")} == names


def test_contrast_is_that_of_wcag() -> None:
    assert contrast("#000000", "#ffffff") == pytest.approx(21)
    assert contrast("#777777", "#ffffff") == pytest.approx(4.48, abs=0.01)  # WCAG's own well-known example
