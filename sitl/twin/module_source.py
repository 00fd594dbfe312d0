"""The source of one module, cut into its definitions, and the global names that each uses."""

from __future__ import annotations

import ast
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from importlib.resources import files

from sitl.twin.global_names import global_names

PACKAGE = "sitl"
Block = ast.FunctionDef | ast.ClassDef


@dataclass(frozen=True, eq=False)
class Piece:
    """One statement of a module with its comments: lines first..last, counted from 0, last not included.

    names: those that it defines; uses: the global names in it; node: the statement.
    """

    node: ast.stmt
    names: tuple[str, ...]
    uses: tuple[ast.Name, ...]
    first: int
    last: int

    @property
    def is_block(self) -> bool:
        return isinstance(self.node, Block | ast.If)


@dataclass(frozen=True, eq=False)
class ModuleSource:
    """A module: its lines, its pieces in order, and its imports by the local name.

    own_imports: (module, name) of this project; libraries: (module, alias), an empty module for `import`.
    """

    name: str
    lines: tuple[str, ...]
    tree: ast.Module
    pieces: tuple[Piece, ...]
    own_imports: Mapping[str, tuple[str, str]]
    libraries: Mapping[str, tuple[str, str]]

    @staticmethod
    def read(name: str, text: str | None = None) -> ModuleSource:
        """The module `name` of this project, from `text` where that is given."""
        if text is None:
            text = files(name.rpartition(".")[0]).joinpath(f"{name.rpartition('.')[2]}.py").read_text("utf-8")
        lines, tree = tuple(text.splitlines()), ast.parse(text)
        own, libraries = _imports(tree)
        return ModuleSource(name, lines, tree, tuple(_pieces(tree, lines)), own, libraries)

    def definition(self, name: str) -> Piece | None:
        """The piece that defines a name."""
        return next((piece for piece in self.pieces if name in piece.names), None)

    def renamed(self, piece: Piece, new: Mapping[str, str]) -> str:
        """The text of a piece with other names for the definitions in `new`."""
        lines = [line.encode() for line in self.lines[piece.first : piece.last]]
        changes = [(u.lineno, u.col_offset, u.id) for u in piece.uses if new.get(u.id, u.id) != u.id]
        if isinstance(piece.node, Block) and new.get(piece.node.name, piece.node.name) != piece.node.name:
            line = piece.node.lineno - 1 - piece.first
            changes.append((piece.node.lineno, lines[line].index(piece.node.name.encode()), piece.node.name))
        for line, column, name in sorted(changes, reverse=True):
            text = lines[line - 1 - piece.first]
            lines[line - 1 - piece.first] = text[:column] + new[name].encode() + text[column + len(name) :]
        return b"\n".join(lines).decode()


def _imports(tree: ast.Module) -> tuple[dict[str, tuple[str, str]], dict[str, tuple[str, str]]]:
    own: dict[str, tuple[str, str]] = {}
    libraries: dict[str, tuple[str, str]] = {}
    for node in tree.body:
        if isinstance(node, (ast.Import, ast.ImportFrom)):
            module = str(node.module) if isinstance(node, ast.ImportFrom) else ""
            for alias in node.names:
                if module.split(".")[0] == PACKAGE:
                    own[alias.asname or alias.name] = module, alias.name
                elif module != "__future__":
                    libraries[alias.asname or alias.name] = module, ast.unparse(alias)
    return own, libraries


def _pieces(tree: ast.Module, lines: Iterable[str]) -> Iterator[Piece]:
    text = tuple(lines)
    for k, node in enumerate(tree.body):
        if isinstance(node, (ast.Import, ast.ImportFrom, ast.Expr)):
            continue
        first, last = _start(node, text), node.end_lineno or node.lineno
        if k + 1 < len(tree.body) and isinstance(words := tree.body[k + 1], ast.Expr):
            last = words.end_lineno or last  # the text that explains a constant
        yield Piece(node, _defined(node), tuple(global_names(node)), first, last)


def _start(node: ast.stmt, lines: tuple[str, ...]) -> int:
    """The first line of a statement with its decorators and the comments above."""
    decorators = node.decorator_list if isinstance(node, Block) else []
    first = min([node.lineno, *(d.lineno for d in decorators)]) - 1
    while first and lines[first - 1].startswith("#"):
        first -= 1
    return first


def _defined(node: ast.stmt) -> tuple[str, ...]:
    if isinstance(node, Block):
        return (node.name,)
    if isinstance(node, (ast.Assign, ast.AnnAssign)):
        targets = node.targets if isinstance(node, ast.Assign) else [node.target]
        return tuple(n.id for target in targets for n in ast.walk(target) if isinstance(n, ast.Name))
    return ()
