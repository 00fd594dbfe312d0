"""How a link gets at its vehicle: what its user says beforehand, and where the user is told something."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass


def _nobody(sentence: str) -> None:
    """Nobody is told."""


@dataclass(frozen=True)
class Access:
    """tell: is given a sentence for each thing that a link notices beside its vehicle, such as a stranger on
    its UDP port; it may be called wherever somebody waits on the link."""

    tell: Callable[[str], None] = _nobody
