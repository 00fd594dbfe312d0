"""One name for one thing: no two public classes or functions of rover_sweep share a name.

SAME_NAME lists the exceptions with their reasons. Click commands are exempt: each has the name
of its verb.
"""

from __future__ import annotations

import ast
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

PACKAGE = Path(__file__).parents[2] / "rover_sweep"
VERB = "one verb: the core computes it, api orchestrates it, a command or a screen shows it"
REPORTS = "report/identification and report/diagnosis are parallel"
SAME_NAME = {
    "compare": VERB,
    "cost_table": REPORTS,
    "diagnose": VERB,
    "fit": "the fit of each of the two cores",
    "identify": VERB,
    "identify_speed": VERB,
    "motion": "one for each kind of baseline",
}
Definition = ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef


def definitions(path: Path) -> Iterator[str]:
    """Public classes and functions of a module, without click commands and groups."""
    for node in ast.parse(path.read_text()).body:
        if isinstance(node, Definition) and not node.name.startswith("_") and not is_command(node):
            yield node.name


def is_command(node: Definition) -> bool:
    """Decorated as in `@click.command()` or `@firmware.command()`."""
    calls = [d.func for d in node.decorator_list if isinstance(d, ast.Call)]
    return any(isinstance(f, ast.Attribute) and f.attr in ("command", "group") for f in calls)


def repeated(homes: Mapping[str, Sequence[str]]) -> dict[str, list[str]]:
    return {name: sorted(places) for name, places in homes.items() if len(places) > 1}


def test_public_names_are_unique() -> None:
    homes: dict[str, list[str]] = defaultdict(list)
    for path in PACKAGE.rglob("*.py"):
        for name in definitions(path):
            homes[name].append(str(path.relative_to(PACKAGE)))
    found = repeated(homes)
    assert not {name: places for name, places in found.items() if name not in SAME_NAME}
    assert not SAME_NAME.keys() - found.keys(), "an exception that is no longer needed"
