"""Formulas such as "(a*Cf - b*Cr)/(m*V)", parsed from text and evaluated without Python's eval.

Only numbers, names, + - * / ** and parentheses are allowed, so every formula is analytic. Derivatives by
complex step need that.
"""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

LONGEST = 500  # characters of an entry
OPERATORS: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
}
Evaluate = Callable[[Mapping[str, Any]], Any]


@dataclass(frozen=True, eq=False)
class Expression:
    """A formula. names: the names in it; calling it with {name: value} gives its value."""

    text: str
    names: frozenset[str]
    evaluate: Evaluate

    def __call__(self, values: Mapping[str, Any]) -> Any:
        return self.evaluate(values)


def parsed(source: str | float) -> Expression:
    """A formula from its text or from a number. ValueError with the reason for anything else."""
    if isinstance(source, bool) or not isinstance(source, str | int | float):
        raise ValueError(f"{source!r} is neither a number nor a formula in quotes")
    text = str(source).strip()
    if len(text) > LONGEST:
        raise ValueError(f"a formula of {len(text)} characters is too long; at most {LONGEST}")
    try:
        tree = ast.parse(text, mode="eval")
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise ValueError(
            f"{text!r} is not a formula; use numbers, names, + - * / ** and parentheses"
        ) from None
    names = frozenset(node.id for node in ast.walk(tree) if isinstance(node, ast.Name))
    return Expression(text, names, _compiled(tree.body, text))


def _compiled(node: ast.expr, text: str) -> Evaluate:
    match node:
        case ast.Constant(value=int() | float() as number) if not isinstance(number, bool):
            value = float(number)
            return lambda _: value
        case ast.Name(id=name):
            return lambda values: values[name]
        case ast.UnaryOp(op=ast.USub(), operand=inner):
            negated = _compiled(inner, text)
            return lambda values: -negated(values)
        case ast.UnaryOp(op=ast.UAdd(), operand=inner):
            return _compiled(inner, text)
        case ast.BinOp(left=left, op=op, right=right) if type(op) in OPERATORS:
            return _binary(OPERATORS[type(op)], _compiled(left, text), _compiled(right, text))
    raise ValueError(
        f"{text!r} contains {ast.unparse(node)!r}, which is not allowed; use numbers, names, + - * / ** and "
        "parentheses"
    )


def _binary(operation: Callable[[Any, Any], Any], a: Evaluate, b: Evaluate) -> Evaluate:
    return lambda values: operation(a(values), b(values))
