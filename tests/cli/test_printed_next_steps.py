"""Every command that the program prints as a next step is parsed by that command's own parser.

The sentences are found in the source: what is interpolated becomes a value that fits, both branches of a
condition are taken. A command that lacks an option it needs, or has one that does not exist, fails here.
"""

from __future__ import annotations

import ast
import re
import shlex
from collections.abc import Iterator
from itertools import product
from pathlib import Path

import click
import pytest

from rover_sweep.cli.main import COMMANDS, cli

SOURCE = Path(__file__).parents[2] / "rover_sweep"
PLACE = "1"  # fits a file, a folder, a number and a name
# Interpolated expressions that are no single value, with one of their values.
VALUES = {
    "type": "sweep",
    "values": "150",
    "' '.join(to_drive)": "--sweep 120 --doublet 150",
    "again": "1 --vehicle 1",
    "given": "1",
    "ids": "sweep",
}
WORDS = re.compile(r"rover-sweep [a-z][a-z-]*(?: (?:[^;`()\n.]|\.(?! ))*)?")


def texts(node: ast.expr) -> list[str]:
    """All texts that the expression can be, with `PLACE` for what is interpolated."""
    if isinstance(node, ast.Constant):
        return [node.value] if isinstance(node.value, str) else [PLACE]
    if isinstance(node, ast.JoinedStr):
        return ["".join(parts) for parts in product(*map(texts, node.values))]
    if isinstance(node, ast.FormattedValue):
        known = VALUES.get(ast.unparse(node.value))
        return [known] if known else texts(node.value)
    if isinstance(node, ast.IfExp):
        return [*texts(node.body), *texts(node.orelse)]
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        return [left + right for left in texts(node.left) for right in texts(node.right)]
    return [PLACE]


def sentences(tree: ast.Module) -> Iterator[tuple[str, bool]]:
    """(text, whether it is a next step) of the outermost strings, without docstrings."""
    steps = {
        id(part)
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "say_next"
        for argument in node.args
        for part in ast.walk(argument)
    }
    documented = {
        id(body[0].value)
        for node in ast.walk(tree)
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef)
        and (body := node.body)
        and isinstance(body[0], ast.Expr)
    }
    inner = {id(part) for node in ast.walk(tree) if isinstance(node, ast.JoinedStr) for part in node.values}
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr | ast.Constant) and id(node) not in inner | documented:
            yield from ((text, id(node) in steps or text.startswith("next: ")) for text in texts(node))


def printed_commands() -> list[str]:
    """Commands of the source's sentences: next steps whole, other mentions if they name an option."""
    found = set()
    for path in sorted(SOURCE.rglob("*.py")):
        for sentence, is_step in sentences(ast.parse(path.read_text())):
            for command in WORDS.findall(sentence):
                words = command.strip().rstrip(",.")
                if words.split()[1] in COMMANDS and (" --" in words or is_step):
                    found.add(words)
    return sorted(found)


COMMANDS_PRINTED = printed_commands()


def refusal(command: str) -> str:
    """Why the command's parser refuses it; '' if it does not."""
    words = [word for word in shlex.split(command, comments=False)[1:] if word != ">"]
    context = click.Context(cli, info_name="rover-sweep")
    group: click.Group = cli
    try:
        while True:
            name, found, words = group.resolve_command(context, words)
            assert found is not None
            if not isinstance(found, click.Group) or not words or words[0].startswith("-"):
                found.make_context(name, list(words), parent=context)
                return ""
            group, context = found, click.Context(found, parent=context, info_name=name)
    except click.ClickException as error:
        return error.format_message()


def test_the_next_steps_are_found():
    assert len(COMMANDS_PRINTED) > 30
    assert "rover-sweep logs fetch 1 --connect 1" in COMMANDS_PRINTED


@pytest.mark.parametrize("command", COMMANDS_PRINTED)
def test_a_printed_command_is_accepted_by_its_parser(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    refused = refusal(command)
    if refused.endswith("does not exist."):  # what it names is a folder, such as a session's
        (tmp_path / PLACE).mkdir()
        refused = refusal(command)
    assert refused == ""


@pytest.mark.parametrize(
    ("command", "why"),
    [
        ("rover-sweep identify today", "Missing option '--out'"),
        ("rover-sweep status", "Missing argument"),
        ("rover-sweep logs fetch 1 --nowhere 2", "No such option"),
    ],
)
def test_a_command_that_cannot_work_is_refused(command, why):
    assert why in refusal(command)
