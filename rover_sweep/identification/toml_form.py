"""A model structure written by a user as a short TOML text: M x' = F x + G u(t - tau), y = H0 x + H1 x'.

    name = "my-bicycle"                  # letters, digits, - and _
    states = ["beta", "r"]
    inputs = ["delta"]                   # the default; the steering angle [rad] comes first
    outputs = ["r", "ay"]                # channels of a recording, or vydot

    [parameters]
    C = { value = 39, unit = "N/rad", free = true, lower = 0.1, upper = 1e4, meaning = "each axle" }
    Cr = { tied = "0.9 * C", unit = "N/rad" }
    tau = { value = 0.03, unit = "s", free = true, lower = 0, upper = 0.5 }
    m = 2.66                             # a bare number is fixed

    [matrices]                           # formulas of parameters, the speed V [m/s] and g [m/s^2]
    F = [["-(C + Cr)/(m*V)", ...], ...]  # M is the identity, H0 and H1 are zero where they are not given

    [delays]                             # by input or output; without it, tau delays the first input
    delta = "tau"

`StructureError` lists all mistakes at once. No files are read.
"""

from __future__ import annotations

import ast
import keyword
import math
import operator
import re
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rover_sweep.data.geometry import GRAVITY
from rover_sweep.files.documents import read_toml
from rover_sweep.identification.state_space import Matrices, ModelStructure, Parameter

# Formulas such as "(a*Cf - b*Cr)/(m*V)", parsed from text and evaluated without Python's eval.
#
# Only numbers, names, + - * / ** and parentheses are allowed, so every formula is analytic. Derivatives by
# complex step need that.


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
            operation, a, b = OPERATORS[type(op)], _compiled(left, text), _compiled(right, text)
            return lambda values: operation(a(values), b(values))
    raise ValueError(
        f"{text!r} contains {ast.unparse(node)!r}, which is not allowed; use numbers, names, + - * / ** and "
        "parentheses"
    )


KEYS = ("name", "reference", "states", "inputs", "outputs", "parameters", "matrices", "delays", "units")
PARAMETER_KEYS = ("value", "unit", "free", "lower", "upper", "tied", "meaning")
MATRICES = ("M", "F", "G", "H0", "H1")
TRIAL_SPEED = 2.0  # m/s, at which the matrices are checked


class StructureError(ValueError):
    """A text that does not describe a structure; the message has one line for each mistake."""


@dataclass(frozen=True, eq=False)
class FormulaMatrices:
    """Builds Matrices from formulas {M, F, G, H0, H1: rows of Expression}."""

    rows: Mapping[str, tuple[tuple[Expression, ...], ...]]

    def __call__(self, values: Mapping[str, Any]) -> Matrices:
        known = {"g": GRAVITY, **values}
        made = {n: np.array([[e(known) for e in row] for row in rows]) for n, rows in self.rows.items()}
        return Matrices(made["M"], made["F"], made["G"], made["H0"], made["H1"])

    @property
    def names(self) -> frozenset[str]:
        """Every name in the formulas."""
        return frozenset(n for rows in self.rows.values() for row in rows for e in row for n in e.names)


def structure_from_text(text: str) -> ModelStructure:
    """The structure that a TOML text describes. StructureError with one line for each mistake."""
    try:
        data = read_toml(text)
    except tomllib.TOMLDecodeError as error:
        raise StructureError(f"this is not valid TOML: {error}") from None
    reader = _Reader(data)
    structure = reader.structure(text)
    if structure is None:
        raise StructureError("\n".join(reader.problems))
    return structure


class _Reader:
    """Reads the parts of a structure and collects the mistakes in them."""

    def __init__(self, data: Mapping[str, Any]) -> None:
        self.data = data
        self.problems = [f"unknown key {k!r}; the keys are {', '.join(KEYS)}" for k in data if k not in KEYS]

    def structure(self, text: str) -> ModelStructure | None:
        """The structure, or None with `problems` filled."""
        name = self._name()
        states, outputs = self._names("states"), self._names("outputs")
        inputs = self._names("inputs") if "inputs" in self.data else ("delta",)
        parameters = self._parameters()
        if self.problems:
            return None
        build = self._matrices(states, inputs, outputs)
        late_in, late_out = self._delays(inputs, outputs, [p.name for p in parameters])
        if build:
            self._check_names(build, parameters, {*late_in.values(), *late_out.values()})
        if build is None or self.problems:
            return None
        units = self.data.get("units", {})
        structure = ModelStructure(
            name,
            states,
            outputs,
            parameters,
            build,
            str(self.data.get("reference", "a user's file")),
            inputs,
            late_in,
            late_out,
            {k: str(v) for k, v in units.items()} if isinstance(units, dict) else {},
            text,
        )
        self.problems += _trial(structure)
        return None if self.problems else structure

    def _name(self) -> str:
        name = self.data.get("name")
        if isinstance(name, str) and re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_-]*", name):
            return name
        self.problems.append(f'name is {name!r}; use letters, digits, - and _: name = "my-model"')
        return ""

    def _names(self, key: str) -> tuple[str, ...]:
        names = self.data.get(key)
        if not isinstance(names, list) or not names or not all(isinstance(n, str) and n for n in names):
            self.problems.append(f'{key} is {names!r}; give a list of names such as {key} = ["r"]')
            return ()
        if len(set(names)) < len(names):
            self.problems.append(f"{key} has a name twice: {', '.join(names)}")
        if key == "inputs" and names[0] != "delta":
            self.problems.append(f"the first input is {names[0]!r}; it must be the steering angle, delta")
        return tuple(names)

    def _parameters(self) -> tuple[Parameter, ...]:
        table = self.data.get("parameters")
        if not isinstance(table, dict) or not table:
            self.problems.append("there are no parameters; give a table [parameters]")
            return ()
        found = [self._parameter(name, entry) for name, entry in table.items()]
        parameters = tuple(p for p in found if p)
        self._check_ties({p.name: p for p in parameters})
        return parameters

    def _parameter(self, name: str, entry: Any) -> Parameter | None:
        if not name.isidentifier() or keyword.iskeyword(name) or name == "V":
            why = "is the name of the speed" if name == "V" else "cannot be used in a formula"
            self.problems.append(f"parameter {name!r} {why}; choose another name")
            return None
        given = entry if isinstance(entry, dict) else {"value": entry}
        for key in given:
            if key not in PARAMETER_KEYS:
                self.problems.append(
                    f"{name} has an unknown key {key!r}; the keys are {', '.join(PARAMETER_KEYS)}"
                )
        numbers = {k: self._number(name, k, given.get(k)) for k in ("value", "lower", "upper")}
        tied, free = self._tie(name, given.get("tied")), given.get("free", False)
        if not isinstance(free, bool):
            self.problems.append(f"{name}: free is {free!r}; it must be true or false")
        if (numbers["value"] is None) == (tied is None):
            self.problems.append(f'{name} needs either a value or a tie, such as tied = "0.9 * C"')
        low = -math.inf if numbers["lower"] is None else numbers["lower"]
        high = math.inf if numbers["upper"] is None else numbers["upper"]
        value = numbers["value"] or 0.0
        if tied is None and not (low < high and low <= value <= high):
            self.problems.append(f"{name}: need lower <= value <= upper, got {low:g}, {value:g}, {high:g}")
        if tied and free:
            self.problems.append(f"{name} is tied to {tied[0]}, so it cannot be free")
        unit, meaning = str(given.get("unit", "")), str(given.get("meaning", ""))
        return Parameter(name, unit, value, free is True, low, high, meaning, tied)

    def _number(self, name: str, key: str, value: Any) -> float | None:
        if value is None:
            return None
        if isinstance(value, bool) or not isinstance(value, int | float) or math.isnan(value):
            self.problems.append(f"{name}: {key} is {value!r}; it must be a number")
            return 0.0
        return float(value)

    def _tie(self, name: str, text: Any) -> tuple[str, float] | None:
        """("C", 0.9) from "0.9 * C": a formula proportional to one other parameter."""
        if text is None:
            return None
        try:
            formula = parsed(text)
            (other,) = formula.names
            factor, twice, none = (float(formula({other: x})) for x in (1.0, 2.0, 0.0))
            if none == 0 and math.isclose(twice, 2 * factor):
                return other, factor
        except (ValueError, ArithmeticError):
            pass
        self.problems.append(f'{name}: tied is {text!r}; give a factor times one parameter, as "0.9 * C"')
        return None

    def _check_ties(self, known: Mapping[str, Parameter]) -> None:
        for p in known.values():
            if p.tied and p.tied[0] not in known:
                self.problems.append(f"{p.name} is tied to {p.tied[0]!r}, which is not a parameter")
            elif p.tied and known[p.tied[0]].tied:
                self.problems.append(
                    f"{p.name} is tied to {p.tied[0]}, which is tied itself; tie it to one with a value"
                )

    def _matrices(
        self, states: Sequence[str], inputs: Sequence[str], outputs: Sequence[str]
    ) -> FormulaMatrices | None:
        table = self.data.get("matrices")
        if not isinstance(table, dict):
            self.problems.append("there are no matrices; give a table [matrices] with F, G and H0")
            return None
        self.problems += [
            f"unknown matrix {k!r}; the matrices are {', '.join(MATRICES)}"
            for k in table
            if k not in MATRICES
        ]
        if not {"H0", "H1"} & set(table):
            self.problems.append("matrix H0 is missing: no output depends on any state")
        n, ny = len(states), len(outputs)
        shapes = {"M": (n, n), "F": (n, n), "G": (n, len(inputs)), "H0": (ny, n), "H1": (ny, n)}
        rows = {name: self._matrix(name, table.get(name), *shape) for name, shape in shapes.items()}
        return FormulaMatrices(rows)

    def _matrix(self, name: str, given: Any, rows: int, columns: int) -> tuple[tuple[Expression, ...], ...]:
        if given is None and name in ("F", "G"):
            self.problems.append(f"matrix {name} is missing; it needs {rows} rows of {columns}")
            return ()
        if given is None:
            diagonal = 1.0 if name == "M" else 0.0
            given = [[diagonal if i == j else 0.0 for j in range(columns)] for i in range(rows)]
        if name == "G" and columns == 1 and isinstance(given, list):
            given = [row if isinstance(row, list) else [row] for row in given]
        if not isinstance(given, list) or not all(isinstance(row, list) for row in given):
            self.problems.append(f'matrix {name} must be a list of rows, such as [["1/m", 0]]')
            return ()
        widths = [len(row) for row in given]
        if widths != [columns] * rows:
            seen = (
                f"{rows} rows of {columns}, not {len(widths)} of {', '.join(map(str, sorted(set(widths))))}"
            )
            self.problems.append(f"matrix {name} needs {seen} (states by states, inputs or outputs)")
            return ()
        return tuple(
            tuple(self._entry(f"{name} row {i} column {j}", e) for j, e in enumerate(row, 1))
            for i, row in enumerate(given, 1)
        )

    def _entry(self, place: str, entry: Any) -> Expression:
        try:
            return parsed(entry)
        except ValueError as error:
            self.problems.append(f"{place}: {error}")
            return parsed(0.0)

    def _delays(
        self, inputs: Sequence[str], outputs: Sequence[str], parameters: Sequence[str]
    ) -> tuple[dict[str, str], dict[str, str]]:
        default = {inputs[0]: "tau"} if "tau" in parameters else {}
        table = self.data.get("delays", default)
        if not isinstance(table, dict):
            self.problems.append(f'delays is {table!r}; give a table [delays] such as delta = "tau"')
            return {}, {}
        for place, name in table.items():
            if place not in inputs and place not in outputs:
                self.problems.append(f"a delay is given for {place!r}, which is neither input nor output")
            if name not in parameters:
                self.problems.append(f"the delay of {place} is {name!r}, which is not a parameter")
        return {k: v for k, v in table.items() if k in inputs}, {
            k: v for k, v in table.items() if k in outputs
        }

    def _check_names(self, build: FormulaMatrices, parameters: Sequence[Parameter], delays: set[str]) -> None:
        known = {p.name for p in parameters} | {"V", "g"}
        for name, rows in build.rows.items():
            for i, row in enumerate(rows, 1):
                for j, e in enumerate(row, 1):
                    wrong = sorted(e.names - known)
                    if wrong:
                        self.problems.append(
                            f"{name} row {i} column {j}: {e.text!r} uses {wrong[0]!r}, which is no parameter"
                        )
        tied = {p.tied[0]: p.name for p in parameters if p.tied and p.name in build.names | delays}
        for p in parameters:
            if p.free and p.name not in build.names | delays and p.name not in tied:
                self.problems.append(f"{p.name} is free, but no matrix and no delay uses it")


def _trial(structure: ModelStructure) -> list[str]:
    """Sentences on what is wrong with the matrices at the starting values and 2 m/s."""
    at = f"at the starting values and V = {TRIAL_SPEED:g} m/s"
    try:
        mat = structure.matrices(TRIAL_SPEED)
        whole = np.concatenate([np.ravel(a) for a in (mat.m, mat.f, mat.g, mat.h0, mat.h1)])
    except (ArithmeticError, ValueError) as error:
        return [f"a matrix cannot be computed {at}: {error}"]
    if np.iscomplexobj(whole) or not np.all(np.isfinite(whole)):
        return [f"a matrix is not finite and real {at}"]
    if np.linalg.matrix_rank(mat.m) < len(mat.m):
        return [f"M has no inverse {at}"]
    w = np.array([1.0, 7.0])
    return [
        f"no input affects the output {o} {at}"
        for o in structure.outputs
        if not any(np.any(structure.response(w, TRIAL_SPEED, o, input=i)) for i in structure.inputs)
    ]
