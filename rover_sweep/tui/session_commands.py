"""The command palette: every key of the view on top, found by what it does."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

from textual.command import DiscoveryHit, Hit, Hits, Provider
from textual.dom import DOMNode

from rover_sweep.tui.screens.session_screen import SessionScreen

DRIVES = "go"
ARROWS = ("up", "down", "left", "right")


class SessionCommands(Provider):
    """What the keys do, but for driving: a run is started by its own key alone, not by a search."""

    def _commands(self) -> Iterator[tuple[str, str, DOMNode]]:
        """(words, action, whose action it is) of the active keys."""
        if not isinstance(self.screen, SessionScreen):
            return
        seen: set[str] = set()
        for active in self.screen.active_bindings.values():
            binding = active.binding
            words = binding.description
            if binding.action.startswith("view("):
                words = "view " + binding.action.split("'")[1]
            offered = (
                binding.show and active.enabled and binding.action != DRIVES and binding.key not in ARROWS
            )
            if offered and words not in seen:
                seen.add(words)
                key = binding.key if words.startswith("view ") else binding.key_display or binding.key
                yield f"{words} ({key.upper()})", binding.action, active.node

    async def discover(self) -> Hits:
        for words, action, node in self._commands():
            yield DiscoveryHit(words, partial(self._run, action, node))

    async def search(self, query: str) -> Hits:
        matcher = self.matcher(query)
        for words, action, node in self._commands():
            if (score := matcher.match(words)) > 0:
                yield Hit(score, matcher.highlight(words), partial(self._run, action, node))

    async def _run(self, action: str, node: DOMNode) -> None:
        await self.app.run_action(action, node)
