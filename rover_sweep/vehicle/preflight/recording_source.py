"""Check that says which recording the runs will be identified from, and why."""

from __future__ import annotations

from rover_sweep.vehicle.preflight.item import Check, Remedy
from rover_sweep.vehicle.preflight.observed import Observation
from rover_sweep.vehicle.preflight.onboard import logging
from rover_sweep.vehicle.preflight.rates import streams

_SLOW = 20.0  # Hz: a stream that is wanted no faster is not identified from


def source(seen: Observation) -> Check:
    """The rover's own log (.BIN) where one is written, else the telemetry (.tlog) where that comes well.

    The log has the applet's steering and the IMU at the loop's rate on one clock, and no radio in between.
    """
    log, telemetry = logging(seen), streams(seen)
    fast = {s.message for s in seen.streams if s.wanted_hz > _SLOW}
    came = [q for q in seen.quality if q.count > 2 and q.message in fast]
    rate = f"{min(q.mean_hz for q in came):.0f} Hz" if came else "nothing"
    if log.state == "good":
        loop = seen.parameter("SCHED_LOOP_RATE")
        at = "" if loop != loop else f" at {loop:.0f} Hz"
        instead = (
            f"the .tlog ({rate}) would do without it"
            if telemetry.state == "good"
            else f"the .tlog ({rate}) would not do instead"
        )
        sentence = f"it has steering and IMU{at} on one clock whatever the radio loses; {instead}"
        return Check("source", "good", "the .BIN log, fetched after the runs", sentence)
    why = log.sentence or "the rover does not tell whether it logs"
    if telemetry.state == "good":
        hand = Remedy("put the logging right first, or go on with the telemetry", by_hand=True)
        return Check("source", "doubtful", f"the .tlog, {rate}", f"no good log: {why}", hand)
    hand = Remedy("put logging or streams right: see there", by_hand=True)
    return Check("source", "bad", "neither", f"no good log: {why}; nor telemetry: {telemetry.sentence}", hand)
