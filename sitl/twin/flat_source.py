"""One Python file out of a module of this package: its source and all that it uses, without the rest.

Only definitions that are reached are taken. Two of the same name get different ones. Code of modules runs in
the order in which Python would import them.
"""

from __future__ import annotations

import ast
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping
from graphlib import TopologicalSorter

from sitl.twin.module_source import ModuleSource, Piece

Key = tuple[str, str]
"""(module, name)"""


def flat_source(root: str, given: Mapping[str, str]) -> str:
    """The source of the module `root` with what it uses from this project; imports of libraries stay.

    given: source texts that replace those of modules. ValueError for an import that cannot be resolved.
    """
    bundle = _Bundle(given)
    bundle.take_all(root)
    return bundle.text()


class _Bundle:
    """The pieces that are taken, by module."""

    def __init__(self, given: Mapping[str, str]) -> None:
        self._given = given
        self._modules: dict[str, ModuleSource] = {}
        self._taken: dict[str, set[Piece]] = {}
        self._libraries: dict[str, tuple[str, str]] = {}  # name -> (module, alias)

    def take_all(self, root: str) -> None:
        for piece in self._module(root).pieces:
            self._take(root, piece)

    def text(self) -> str:
        """Imports, then the pieces of each module under its title."""
        names = self._flat_names()
        parts = [self._part(module, names) for module in self._order()]
        return "\n".join([*_statements(self._libraries.values()), "", "", "\n\n\n".join(parts), ""])

    def _module(self, name: str) -> ModuleSource:
        if name not in self._modules:
            self._modules[name] = ModuleSource.read(name, self._given.get(name))
        return self._modules[name]

    def _take(self, name: str, piece: Piece) -> None:
        if piece in self._taken.setdefault(name, set()):
            return
        self._taken[name].add(piece)
        module = self._module(name)
        for used in piece.uses:
            if used.id in module.libraries:
                self._take_library(used.id, module.libraries[used.id])
            elif (home := self._home(name, used.id)) and (found := self._module(home[0]).definition(home[1])):
                self._take(home[0], found)

    def _take_library(self, name: str, source: tuple[str, str]) -> None:
        if self._libraries.setdefault(name, source) != source:
            raise ValueError(f"two imports have the name {name}: {source}, {self._libraries[name]}")

    def _home(self, name: str, used: str) -> Key | None:
        """Where a name of a module is defined; None for a builtin, ValueError for an import of nothing."""
        module = self._module(name)
        if used not in module.own_imports:
            return (name, used) if module.definition(used) else None
        other, original = module.own_imports[used]
        if home := self._home(other, original):
            return home
        raise ValueError(f"{other} does not define {original}, which {name} imports")

    def _order(self) -> list[str]:
        """The modules that have a taken piece, each after those that it imports."""
        graph = {
            name: [other for other, _ in self._module(name).own_imports.values() if other in self._taken]
            for name in self._taken
        }
        return list(TopologicalSorter(graph).static_order())

    def _flat_names(self) -> dict[Key, str]:
        """A name of its own for each definition: of several `f`, that of module m is `f_m`."""
        keys = [(m, name) for m, pieces in self._taken.items() for piece in pieces for name in piece.names]
        count = Counter([name for _, name in keys] + list(self._libraries))
        return {key: _named_after(*key) if count[key[1]] > 1 else key[1] for key in keys}

    def _part(self, name: str, names: Mapping[Key, str]) -> str:
        module = self._module(name)
        new: dict[str, str] = {}
        for piece in self._taken[name]:
            for used in (node.id for node in piece.uses):
                if home := self._home(name, used):
                    new[used] = names[home]
            new |= {own: names[name, own] for own in piece.names}
        pieces = [piece for piece in module.pieces if piece in self._taken[name]]
        return "\n".join(
            [_title(name, module.tree), *_spaced(pieces, [module.renamed(p, new) for p in pieces])]
        )


def _statements(libraries: Iterable[tuple[str, str]]) -> list[str]:
    """Import statements, one for each module."""
    grouped: dict[str, set[str]] = defaultdict(set)
    for module, alias in libraries:
        grouped[module].add(alias)
    plain = [f"import {alias}" for alias in sorted(grouped.pop("", ()))]
    return plain + [
        f"from {module} import {', '.join(sorted(grouped[module]))}" for module in sorted(grouped)
    ]


def _named_after(module: str, name: str) -> str:
    stem = module.rpartition(".")[2]
    return f"{name}_{stem.upper() if name.isupper() else stem}"


def _title(name: str, tree: ast.Module) -> str:
    """The name of the file between lines, and its docstring, as comments."""
    words = (ast.get_docstring(tree) or "").splitlines()
    head = [f"# {name.rpartition('.')[2].replace('_', ' ')} ".ljust(100, "-")]
    return "\n".join([*head, "#", *(f"# {line}".rstrip() for line in words), ""])


def _spaced(pieces: list[Piece], texts: list[str]) -> list[str]:
    """Two empty lines around classes and functions."""
    out: list[str] = []
    for k, (piece, text) in enumerate(zip(pieces, texts, strict=True)):
        apart = k and (piece.is_block or pieces[k - 1].is_block)
        out += ["", "", text] if apart else [text]
    return out
