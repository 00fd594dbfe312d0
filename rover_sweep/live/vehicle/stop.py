"""Stopping: the exception that ends a run at once."""

from __future__ import annotations


class Aborted(KeyboardInterrupt):
    """Somebody pressed abort. A KeyboardInterrupt, so that a run lets the rover go as after Ctrl-C."""
