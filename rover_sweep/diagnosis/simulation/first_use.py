"""Whether the compiled loops of the simulation are kept on disk from an earlier run on this machine."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rover_sweep.diagnosis.simulation import single_track

COMPILING = "compiling the simulation, once on this machine (up to a minute)"


def must_compile(loop: Any = single_track.single_tracks) -> bool:
    """True before the only run that compiles; False too where numba does not say."""
    try:
        return not Path(loop._cache._cache_file._index_path).is_file()
    except AttributeError:  # another version of numba
        return False
