"""Yes or no, at the terminal."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import click

from rover_sweep.cli.views.typed_ahead import forget_typed
from rover_sweep.files.printable import printable_lines


def confirmed(question: str) -> bool:
    """Asked on stderr; what was typed before is no answer."""
    forget_typed()
    return click.confirm(printable_lines(question), err=True)


def chosen_of(question: str, answers: Sequence[str]) -> str:
    """One of `answers`, asked on stderr until it is one; what was typed before is no answer."""
    forget_typed()
    return str(click.prompt(printable_lines(question), type=click.Choice(answers), err=True))


def reboot_consent(given: bool) -> Callable[[tuple[str, ...]], bool]:
    """Consent to a reboot for some reasons, asked when it is due; given: beforehand, for every one."""
    return lambda because: given or confirmed(f"Reboot the rover, for {', '.join(because)}?")
