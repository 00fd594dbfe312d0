"""Check of the free space on this computer's disk against the size of a run."""

from __future__ import annotations

from rover_sweep.manoeuvre.sweep import Sweep
from rover_sweep.vehicle.preflight.item import Check, Remedy
from rover_sweep.vehicle.preflight.observed import Observation

_BEFORE_AND_AFTER = 45.0  # s of log around the manoeuvre: standstill, run-up, 15 s after disarming
_TLOG = 12e3  # B/s at the rates of vehicle.streams: 57 B frames 200 times a second
_LOG_PER_LOOP = 250.0  # B of .BIN per main loop: 25 kB/s at 100 Hz (tests/data/ardurover-4.6.3/nominal)
_RAW = 450e3  # B/s of .BIN more with bit 19, raw IMU (LOG_BITMASK)
_FEW, _MANY = 3, 20  # runs


def run_bytes(loop_rate: float, bitmask: float) -> float:
    """Bytes of a run on this disk, .tlog and .BIN together. loop_rate [Hz]; bitmask: LOG_BITMASK."""
    log = _RAW if bitmask > 0 and int(bitmask) >> 19 & 1 else _LOG_PER_LOOP * max(loop_rate, 50.0)
    return (Sweep().duration + _BEFORE_AND_AFTER) * (_TLOG + log)


def disk(observed: Observation) -> Check:
    """Whether the session's folder has room for its runs."""
    free, folder = observed.disk
    loop = observed.parameter("SCHED_LOOP_RATE")
    each = run_bytes(50.0 if loop != loop else loop, observed.parameter("LOG_BITMASK"))
    value = f"{free / 1e9:.1f} GB free" if free >= 1e9 else f"{free / 1e6:.0f} MB free"
    runs = int(free / each)
    sentence = (
        f"room for {runs} runs of {each / 1e6:.0f} MB in {folder}"
        if runs < 1000
        else f"{each / 1e6:.0f} MB a run"
    )
    if runs < _MANY:
        hand = Remedy("free some space, or use another folder", by_hand=True)
        return Check("disk", "bad" if runs < _FEW else "doubtful", value, sentence, hand)
    return Check("disk", "good", value, sentence)
