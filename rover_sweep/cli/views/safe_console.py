"""A rich console that no control character of a shown text passes; its own colours and cursor moves do."""

from __future__ import annotations

from collections.abc import Iterable

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment

from rover_sweep.files.printable import printable_lines


class SafeConsole(Console):
    """Whatever is printed, table or bar, becomes segments of text here."""

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """As rich, each segment of text printable; rich's own control codes are segments of their own."""
        for segment in super().render(renderable, options):
            safe = segment.control or segment.text.isprintable()
            yield segment if safe else segment._replace(text=printable_lines(segment.text))
