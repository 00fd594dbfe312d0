"""Whether the programs of a simulated rover still run."""

from __future__ import annotations

from sitl.launcher import Running


def all_run(rover: Running) -> bool:
    """True while everything that was started still runs."""
    return all(program.poll() is None for program in rover._programs)
