"""The verdict on a run that did not come to its end, with what to change before it is driven again."""

from __future__ import annotations

import re
from pathlib import Path

from rover_sweep.live.snapshot import Verdict
from rover_sweep.session.content import SessionRun

# as the applet says it, and as `vehicle.run.right_to_move` does
_TOO_FAST = re.compile(r"speed ([\d.]+) (?:> ([\d.]+) m/s|m/s is above SWP_V_MAX ([\d.]+))$")
BELOW_LIMIT = 0.8  # of SWP_V_MAX: the highest speed that a lowered throttle is meant for


def too_fast(reason: str) -> tuple[float, float] | None:
    """(speed, SWP_V_MAX) [m/s] if that limit stopped the run."""
    found = _TOO_FAST.match(reason)
    return (float(found[1]), float(found[2] or found[3])) if found else None


def stopped_verdict(
    planned: SessionRun, reason: str, tlog: Path, throttle: int | None = None, neutral: int | None = None
) -> Verdict:
    """To repeat the run. throttle: with which this program drove, None if the pilot did; neutral: the
    throttle's trim, None if unknown [us].

    A throttle that is too high is lowered in proportion to the speed. The speed was still rising, and a motor
    has a dead zone: so the rover may still be too fast or become too slow, and the proposal is a first step.
    """
    fast = too_fast(reason)
    if fast is None:
        return _repeat(planned, f"it did not come to its end ({reason}): drive it again", tlog)
    speed, limit = fast
    aim = min(planned.speed or limit, BELOW_LIMIT * limit)
    above = f"the speed passed SWP_V_MAX {limit:g} m/s: "
    if throttle is None:
        return _repeat(planned, f"{above}drive it again with less throttle, at {aim:g} m/s", tlog)
    sentence = f"{above}the throttle of {throttle} us is too high for {aim:g} m/s; drive it again with less"
    lower = None if neutral is None else neutral + int((throttle - neutral) * aim / max(speed, limit))
    return _repeat(planned, sentence, tlog, None if lower is None else (throttle, lower))


def _repeat(
    planned: SessionRun, sentence: str, tlog: Path, throttle: tuple[int, int] | None = None
) -> Verdict:
    return Verdict(planned.name, "repeat", sentence, source=tlog, throttle=throttle)
