"""The names in a statement of a module that are those of the module, not of a function or class in it."""

from __future__ import annotations

import ast
from collections.abc import Iterator

_FUNCTIONS = (ast.FunctionDef, ast.Lambda)
_COMPREHENSIONS = (ast.ListComp, ast.SetComp, ast.DictComp, ast.GeneratorExp)


def global_names(node: ast.AST, local: frozenset[str] = frozenset()) -> Iterator[ast.Name]:
    """Every global or builtin name in a node, targets of assignments included; local: names of functions."""
    if isinstance(node, ast.Name):
        if node.id not in local:
            yield node
    elif isinstance(node, _FUNCTIONS):
        yield from _in_function(node, local)
    elif isinstance(node, ast.ClassDef):
        yield from _in_class(node, local)
    else:
        inner = local | _targets(node.generators) if isinstance(node, _COMPREHENSIONS) else local
        for child in ast.iter_child_nodes(node):
            yield from global_names(child, inner)


def _in_function(node: ast.FunctionDef | ast.Lambda, local: frozenset[str]) -> Iterator[ast.Name]:
    body = node.body if isinstance(node.body, list) else [node.body]
    inner = local | {a.arg for a in ast.walk(node.args) if isinstance(a, ast.arg)} | _targets(body)
    for child in ast.iter_child_nodes(node):
        yield from global_names(child, inner if child in body else local)


def _in_class(node: ast.ClassDef, local: frozenset[str]) -> Iterator[ast.Name]:
    """Names that the class binds are seen in its own statements, but not in its functions."""
    own = local | _targets(s for s in node.body if not isinstance(s, ast.FunctionDef))
    for child in ast.iter_child_nodes(node):
        inside = child in node.body and not isinstance(child, ast.FunctionDef)
        yield from global_names(child, own if inside else local)


def _targets(nodes: object) -> frozenset[str]:
    """Names that statements bind, also in comprehensions and nested blocks."""
    found: set[str] = set()
    for node in nodes:  # type: ignore[attr-defined]
        for part in ast.walk(node):
            if isinstance(part, ast.Name) and isinstance(part.ctx, ast.Store):
                found.add(part.id)
            elif isinstance(part, (ast.Import, ast.ImportFrom)):
                found |= {alias.asname or alias.name for alias in part.names}
            elif isinstance(part, (ast.FunctionDef, ast.ClassDef, ast.ExceptHandler)):
                found.add(part.name or "")
    return frozenset(found)
