"""The pictures of the pages are those that docs/draw_pictures.py would draw today."""

from __future__ import annotations

import importlib.util
import re
from html import unescape
from pathlib import Path
from types import ModuleType

import pytest
from printed_pages import DOCS, PAGES

SMALL = 200_000  # bytes


@pytest.fixture(scope="module")
def drawing() -> ModuleType:
    spec = importlib.util.spec_from_file_location("draw_pictures", DOCS / "draw_pictures.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def words(svg: str) -> list[str]:
    return [unescape(text).strip() for text in re.findall(r"<text[^>]*>([^<]*)</text>", svg)]


@pytest.mark.parametrize("scene", ["preflight", "run-steers", "verdict"])
def test_the_screens_are_those_of_the_session(drawing: ModuleType, scene: str) -> None:
    drawn = (DOCS / f"pictures/session-{drawing.SCREENS[scene]}.svg").read_text(encoding="utf-8")
    assert "http" not in drawn.replace('xmlns="http://www.w3.org/2000/svg"', "").split("</style>")[1]
    assert words(drawn) == words(drawing.screen(scene)), "python docs/draw_pictures.py session-run.svg"


def test_the_concealed_rover_can_still_be_made(drawing: ModuleType) -> None:
    rover, plan = drawing.concealed_rover()
    assert rover.numbers.mu == pytest.approx(0.343, abs=1e-3) and len(plan) == 4


def test_each_picture_is_small_and_on_a_page() -> None:
    shown = {name for page in PAGES for name in re.findall(r"pictures/([\w-]+\.\w+)", page.read_text())}
    files = {path.name: path.stat().st_size for path in Path(DOCS / "pictures").iterdir()}
    assert set(files) == shown
    assert not [name for name, size in files.items() if size > SMALL]
