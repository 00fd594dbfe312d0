"""What the runs of an identification.json tell of the loop that they were driven in."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rover_sweep.data.recording import AT_LOOP

SLOWEST_LOOP, FASTEST_LOOP = 20.0, 400.0  # Hz, of ArduRover's main loop


def wait(run: Mapping[str, Any]) -> float:
    """How long the recorded command waited for the main loop, which the controller's output does not, s.

    The applet logs its command when it sets it; the servo gets it with the next main loop, half a period
    later on average (`AP_MotorsUGV::output` calls the one push a loop). Nothing where the command was put at
    the main loops when the log was read, or was logged when it went out (SERVO_OUTPUT_RAW, RCOU).
    """
    main = loop(run)
    source = run["channels"].get("delta", {}).get("source", "")
    waited = source.startswith("SWEP") and not source.endswith(AT_LOOP)
    return 0.5 / main if main and waited else 0.0


def loop(run: Mapping[str, Any]) -> float | None:
    """Main loop [Hz], None where unknown: the IMU is logged once in it."""
    rate = run["channels"].get("r", {}).get("rate_hz")
    return round(float(rate)) * 1.0 if rate and SLOWEST_LOOP <= rate <= FASTEST_LOOP * 1.02 else None


def cutoff(run: Mapping[str, Any]) -> float | None:
    """Low-pass of the gyro [Hz], None where unknown."""
    known = run["filters"].get("r")
    return float(known["cutoff_hz"]) if known else None


def play_remark(steering: Mapping[str, Any] | None) -> tuple[str, ...]:
    """A remark where play was measured on blocks and so taken out of the runs and of the model."""
    half_gap = (steering or {}).get("backlash", {}).get("value", 0.0)
    if not half_gap:
        return ()
    words = (
        f"the steering's play ({half_gap:.3g} rad to either side) is known and no part of this loop: a "
        "correction of less than that comes late or not at all"
    )
    return (words,)


def amplitude(runs: Sequence[Mapping[str, Any]]) -> float | None:
    """The smallest PWM amplitude [us] of the runs, as the quick verdict found it."""
    found = [r["amplitude"] for r in runs if r.get("amplitude") and r.get("amplitude_unit") == "us"]
    return float(min(found)) if found else None
