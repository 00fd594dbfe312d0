"""The documentation's table of effects is that of the library."""

from __future__ import annotations

import re
from pathlib import Path

from rover_sweep.diagnosis.effects import library
from rover_sweep.report.wording import title

README = Path(__file__).parents[2] / "docs/effects.md"
REPORTED = {
    "cross_slope": ("b", "psi0"),  # fitted as a cosine and a sine, reported as size and direction
    "side_wind": ("w", "psi0", "x"),  # likewise
    "suspension_friction": ("T",),  # how sharply it turns over is the simulation's
}


def table() -> dict[str, list[str]]:
    """{id: cells} of the table that begins with the heading id."""
    rows = re.findall(
        r"^\| `(\w+)` \|(.*)\|$", README.read_text().split("| id | equation |")[1], re.MULTILINE
    )
    return {effect: [cell.strip() for cell in cells.split(" | ")] for effect, cells in rows}


def test_every_effect_stands_in_the_readme_and_no_other() -> None:
    assert set(table()) == set(library())
    assert all(len(cells) == 3 and all(cells) for cells in table().values())


def test_the_parameters_are_those_of_the_effects() -> None:
    for effect, cells in table().items():
        names = REPORTED.get(effect) or tuple(p.name for p in library()[effect].parameters)
        assert tuple(re.findall(r"`(\w+)`", cells[1])) == names, effect


def test_every_effect_has_a_title() -> None:
    assert all(" " in title(effect) for effect in library())
    assert title("some_new_effect") == "some new effect"
