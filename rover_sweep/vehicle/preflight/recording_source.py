"""Check that says from which recording the runs will be identified, and why."""

from __future__ import annotations

from rover_sweep.vehicle.preflight.item import Check, Remedy
from rover_sweep.vehicle.preflight.observed import Observation
from rover_sweep.vehicle.preflight.onboard import logging
from rover_sweep.vehicle.preflight.rates import streams

_SLOW = 20.0  # Hz: streams up to this rate are not used for identification


def source(observed: Observation) -> Check:
    """The rover's log (.BIN) if one is written, else the telemetry (.tlog) if its streams are good.

    The log has the applet's steering and the IMU at the loop rate on one clock, without a radio in between.
    """
    log, telemetry = logging(observed), streams(observed)
    fast = {s.message for s in observed.streams if s.wanted_hz > _SLOW}
    came = [q for q in observed.quality if q.count > 2 and q.message in fast]
    rate = f"{min(q.mean_hz for q in came):.0f} Hz" if came else "nothing"
    if log.state == "good":
        loop = observed.parameter("SCHED_LOOP_RATE")
        at = "" if loop != loop else f" at {loop:.0f} Hz"
        instead = (
            f"without it the .tlog ({rate}) is good enough"
            if telemetry.state == "good"
            else f"the .tlog ({rate}) is not good enough to replace it"
        )
        sentence = f"it has steering and IMU{at} on one clock and loses nothing by radio; {instead}"
        return Check("source", "good", "the .BIN log, fetched after the runs", sentence)
    why = log.sentence or "the rover does not report whether it logs"
    if telemetry.state == "good":
        hand = Remedy("correct the logging first, or continue with the telemetry", by_hand=True)
        return Check("source", "doubtful", f"the .tlog, {rate}", f"no good log: {why}", hand)
    hand = Remedy("correct the logging or the streams: see these checks", by_hand=True)
    sentence = f"no good log: {why}; no good telemetry: {telemetry.sentence}"
    return Check("source", "bad", "neither", sentence, hand)
