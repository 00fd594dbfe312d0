"""The column map that docs/formats.md shows is one."""

from __future__ import annotations

import tomllib
from pathlib import Path

from rover_sweep.logs.readers.column_map import parse_column_map

README = Path(__file__).parents[2] / "docs/formats.md"


def test_the_column_map_in_the_readme_is_one() -> None:
    blocks = (part.split("```")[0] for part in README.read_text().split("```toml\n")[1:])
    text = next(block for block in blocks if "columns.toml" in block)
    found = parse_column_map(tomllib.loads(text), ["t", "steer", "yaw_rate"])
    assert found.columns["pwm"].names == ("steer",) and found.frd and found.constants == {"speed": 2.4}
