"""Yes or no, at the terminal."""

from __future__ import annotations

import click

from rover_sweep.typed_ahead import forget_typed


def confirmed(question: str) -> bool:
    """Asked on stderr; what was typed before is no answer."""
    forget_typed()
    return click.confirm(question, err=True)
