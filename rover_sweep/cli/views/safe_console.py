"""A rich console that makes control characters in text visible, but keeps rich's own control codes."""

from __future__ import annotations

from collections.abc import Iterable

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment

from rover_sweep.files.documents import printable_lines


class SafeConsole(Console):
    """Filters the text segments that every renderable, table or bar, is turned into."""

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """As rich, with each text segment made printable; rich's control codes are separate segments."""
        for segment in super().render(renderable, options):
            safe = segment.control or segment.text.isprintable()
            yield segment if safe else segment._replace(text=printable_lines(segment.text))
