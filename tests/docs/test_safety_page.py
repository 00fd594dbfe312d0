"""docs/safety.md is what code and tests are: its tables, the tests it names, its references to itself."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from safety_tables import CAUSES, PAGE, cause_of, written

from rover_sweep.vehicle.run.right_to_move import RULES

ROOT = Path(__file__).parents[2]
TEXT = PAGE.read_text(encoding="utf-8")


def rows(kind: str, cells: int) -> dict[str, list[str]]:
    """The rows with so many cells behind an id that begins with one of these letters."""
    found = re.findall(rf"^\| ([{kind}]\d+) \|(.*)\|$", TEXT, re.MULTILINE)
    split = [(name, [cell.strip() for cell in line.split(" | ")]) for name, line in found]
    return {name: line for name, line in split if len(line) == cells}


HAZARDS, CAUSE_ROWS, BARRIERS = rows("H", 4), rows("C", 2), rows("LKAFP", 3)


def ids(text: str) -> set[str]:
    return set(re.findall(r"\b[HCLKAFP]\d+\b", text))


def test_its_tables_follow_from_the_tests() -> None:
    assert written(TEXT) == TEXT, "python tests/docs/safety_tables.py writes them"


def test_a_fault_that_is_new_belongs_to_a_cause_or_is_refused() -> None:
    with pytest.raises(KeyError, match="belongs to 0 causes"):
        cause_of("meteorite")
    assert {cause for cause, _, _ in CAUSES} <= set(CAUSE_ROWS)


def test_a_table_that_is_changed_by_hand_is_noticed() -> None:
    assert written(TEXT.replace("| 253 |", "| 254 |")) == TEXT


def test_the_tests_that_it_names_exist() -> None:
    named = re.findall(r"`(tests/[\w/]+\.py)::(\w+)`", TEXT)
    assert len(set(named)) > 50
    sources = {file: (ROOT / file).read_text(encoding="utf-8") for file, _ in named}
    assert not [f"{file}::{test}" for file, test in named if f"def {test}(" not in sources[file]]


def test_every_rule_of_the_right_to_move_is_named() -> None:
    assert re.findall(r"`(\w+)`", BARRIERS["L3"][0]) == [rule.__name__ for rule in RULES]


def test_hazards_causes_and_barriers_lead_to_each_other() -> None:
    assert {cause for cells in HAZARDS.values() for cause in ids(cells[2])} == set(CAUSE_ROWS)
    assert {barrier for cells in CAUSE_ROWS.values() for barrier in ids(cells[1])} == set(BARRIERS)
    assert all(ids(cells[1]) for cells in CAUSE_ROWS.values())


def test_every_barrier_has_a_test_or_is_called_a_procedure() -> None:
    assert all("::test_" in cells[1] or "procedure" in cells[1] for cells in BARRIERS.values())
    assert {name[0] for name, cells in BARRIERS.items() if "procedure" in cells[1]} == {"P"}


def test_a_barrier_that_fails_leaves_another() -> None:
    assert not [name for name, cells in CAUSE_ROWS.items() if len(ids(cells[1])) < 2]
