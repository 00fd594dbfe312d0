"""A screen as plain text, and its styles, out of the running application."""

from __future__ import annotations

from collections.abc import Iterator

from textual.app import App


def text_of(app: App[None]) -> str:
    """The rows of the screen on top."""
    rows = (strip.text.rstrip() for strip in app.screen._compositor.render_strips(app.size))
    return "\n".join(rows) + "\n"


def coloured(app: App[None]) -> Iterator[tuple[str, str, str]]:
    """(text, its colour, its ground) of everything that is not blank, as #rrggbb."""
    for strip in app.screen._compositor.render_strips(app.size):
        for segment in strip:
            style = segment.style
            if not segment.text.strip() or style is None:
                continue
            assert style.color is not None and style.bgcolor is not None, segment
            ink, ground = (colour.get_truecolor().hex for colour in (style.color, style.bgcolor))
            yield segment.text, *((ground, ink) if style.reverse else (ink, ground))
