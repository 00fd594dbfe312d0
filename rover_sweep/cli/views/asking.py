"""Questions at the terminal."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import click

from rover_sweep.cli.views.typed_ahead import forget_typed
from rover_sweep.files.printable import printable_lines


def confirmed(question: str) -> bool:
    """True if the user answers yes, asked on stderr; drops what was typed before the question."""
    forget_typed()
    return click.confirm(printable_lines(question), err=True)


def chosen_of(question: str, answers: Sequence[str]) -> str:
    """The user's choice of `answers`, asked on stderr until valid; drops what was typed before."""
    forget_typed()
    return str(click.prompt(printable_lines(question), type=click.Choice(answers), err=True))


def reboot_consent(given: bool) -> Callable[[tuple[str, ...]], bool]:
    """A function that asks for consent to a reboot, given its reasons; given: consent without asking."""
    return lambda because: given or confirmed(f"Reboot the rover to apply {', '.join(because)}?")
