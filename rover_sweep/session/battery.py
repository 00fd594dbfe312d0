"""The battery at the end of a recorded run."""

from __future__ import annotations

from pathlib import Path


def battery_left(tlog: Path) -> float | None:
    """Share of the battery in the last SYS_STATUS, 0 to 1; None where the vehicle does not know it."""
    from rover_sweep.logs.readers.tlog import open_tlog
    from rover_sweep.logs.readers.vehicle_clock import CLOCKS, sessions

    boots = list(sessions(open_tlog(tlog, frozenset((*CLOCKS, "SYS_STATUS"))).messages))
    if not boots or "SYS_STATUS" not in boots[-1].messages:
        return None
    percent = int(boots[-1].messages["SYS_STATUS"].rows["battery_remaining"][-1])
    return percent / 100.0 if 0 <= percent <= 100 else None
